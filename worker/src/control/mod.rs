//! Closed loop: one task per robot, which every controller controls in turn. The last task makes
//! the report.
//!
//! A robot's controllers all begin from the same moment. Random numbers of the planner are keyed by
//! (seed, robot, sample, iteration), so all controllers draw the same. Simulated time stands still
//! while a plan is made; the time that a plan took is recorded and decides nothing.

mod report;
mod table;

use std::ops::ControlFlow;
use std::rc::Rc;
use std::time::Instant;

use evaluation::control::{
    Controller, Experiment, FeedForward, Foreseen, Pursuit, Ran, RobotTrials, Trace, robot_figure,
};
use evaluation::{Learned, Start};
use jobs::ControlTask;
use models::{DataRanges, Sampling};
use spec::{ControlSpec, Given, SimulateSpec};
use wire::{ControllerInfo, PredictorKind};

use crate::attempt::Attempt;
use crate::error::TaskError;
use crate::evaluate::LoadedCheckpoint;
use crate::kinds::KindModule;
use crate::trajectories::TrajectorySource;

pub(crate) const MODULE: KindModule = KindModule { run, computes_models: true };

fn run(attempt: &Attempt) -> Result<(), TaskError> {
    let spec: ControlSpec = attempt.spec()?;
    match attempt.payload()? {
        ControlTask::Robot(index) => robot(attempt, &spec, u64::from(index)),
        ControlTask::Report => report::report(attempt, &spec),
    }
}

/// A controller that is ready for a robot. It gets a function that shows how many samples are done,
/// and gives nothing if that says to stop.
struct Ready<'a> {
    name: String,
    run: Box<dyn Fn(Progress<'_>) -> Option<Ran> + 'a>,
}

type Progress<'a> = &'a dyn Fn(u32) -> ControlFlow<()>;

/// Lets every controller control one robot. Writes its motions to `robot-NN.csv` and
/// `robot-NN.svg`.
fn robot(attempt: &Attempt, spec: &ControlSpec, index: u64) -> Result<(), TaskError> {
    let simulation = simulation(attempt, spec)?;
    let checkpoints = LoadedCheckpoint::load_all(attempt, &spec.checkpoints)?;
    attempt.check_stop()?;
    let ready = match simulation.controller {
        None => planning(spec, &simulation, index, &checkpoints)?,
        Some(_) => feeding_forward(spec, &simulation, index, &checkpoints)?,
    };
    let mut trials = Vec::new();
    let mut warnings = Vec::new();
    let mut traces: Vec<(String, Trace)> = Vec::new();
    let steps = u64::from(spec.steps(simulation.rate_hz));
    for (done, Ready { name, run }) in (0..).zip(ready) {
        attempt.progress.say(name.clone());
        let began = Instant::now();
        let progress = |samples: u32| attempt.show(done * steps + u64::from(samples));
        let ran = attempt.interruptible(|| run(&progress))?;
        let Ran { trial, trace, recorded } = ran.ok_or(TaskError::Stopped)?;
        let seconds = began.elapsed().as_secs_f64();
        tracing::info!(robot = index, controller = name, seconds, "controlled");
        let checkpoint = checkpoints.iter().find(|checkpoint| checkpoint.info.name == name);
        if let Some(trained) =
            checkpoint.and_then(|checkpoint| checkpoint.model.config().ranges.as_ref())
        {
            let found = recorded.and_then(|series| DataRanges::of(&series.view()));
            let outside = found.map(|found| trained.warnings_of(&found)).unwrap_or_default();
            warnings.extend(outside.into_iter().map(|warning| warning.of(&name)));
        }
        trials.push(trial);
        traces.push((name, trace));
    }
    let name = |extension: &str| format!("robot-{index:02}.{extension}");
    let rate_hz = simulation.rate_hz;
    attempt.put(&name("csv"), "text/csv", table::csv(rate_hz, &traces)?)?;
    let figure = robot_figure(index, rate_hz, &traces)?;
    attempt.put(&name("svg"), "image/svg+xml", figure.into_bytes())?;
    attempt.complete(&RobotTrials {
        robot: index,
        joints: simulation.joints(),
        threads: rayon::current_num_threads(),
        trials,
        warnings,
    })
}

/// Controllers that plan the torques of the robot of trajectory `index`.
fn planning<'a>(
    spec: &'a ControlSpec,
    simulation: &'a SimulateSpec,
    index: u64,
    checkpoints: &'a [LoadedCheckpoint],
) -> Result<Vec<Ready<'a>>, TaskError> {
    let experiment = Rc::new(Experiment::new(spec, simulation));
    let plant = experiment.plant(index)?;
    let baseline = |&name| Controller::baseline(name, simulation, plant.robot());
    let learned = checkpoints.iter().map(|checkpoint| learned(checkpoint, spec));
    let controllers: Vec<_> = spec.baselines.iter().map(baseline).chain(learned).collect();
    let ready = controllers.into_iter().map(|controller| {
        let (name, experiment, plant) =
            (controller.name.clone(), Rc::clone(&experiment), plant.clone());
        let run = move |progress: Progress<'_>| {
            experiment.run(index, plant.clone(), &controller, progress)
        };
        Ready { name, run: Box::new(run) }
    });
    Ok(ready.collect())
}

/// Feed-forwards to the controller of the robot of trajectory `index`.
fn feeding_forward<'a>(
    spec: &'a ControlSpec,
    simulation: &'a SimulateSpec,
    index: u64,
    checkpoints: &'a [LoadedCheckpoint],
) -> Result<Vec<Ready<'a>>, TaskError> {
    let pursuit = Rc::new(Pursuit::new(spec, simulation)?);
    let pursued = Rc::new(pursuit.pursued(index)?);
    let baseline = |&name| FeedForward::baseline(name, simulation, pursued.robot());
    let learned = checkpoints
        .iter()
        .map(|checkpoint| FeedForward::learned(&checkpoint.info.name, &checkpoint.model));
    let all: Vec<_> = spec.baselines.iter().map(baseline).chain(learned).collect();
    let ready = all.into_iter().map(|feed_forward| {
        let (name, pursuit, pursued) =
            (feed_forward.name.clone(), Rc::clone(&pursuit), Rc::clone(&pursued));
        let run = move |progress: Progress<'_>| {
            progress(0).is_continue().then(|| pursuit.run(&pursued, &feed_forward))
        };
        Ready { name, run: Box::new(run) }
    });
    Ok(ready.collect())
}

/// A controller that predicts with a checkpoint. A denoiser draws one sample, with the sampler of
/// its checkpoint.
fn learned<'a>(checkpoint: &'a LoadedCheckpoint, spec: &ControlSpec) -> Controller<'a> {
    let LoadedCheckpoint { info, model, .. } = checkpoint;
    let predictor = Learned {
        name: info.name.clone(),
        model,
        sampling: Sampling::default(),
        start: Start::Cold,
        first: None,
    };
    let forecast = Foreseen {
        predictor,
        context: model.context(),
        horizon: Some(model.horizon_of(spec.planner.horizon as usize)),
        rate_hz: model.rate_hz(),
    };
    Controller { name: info.name.clone(), forecast: Some(Box::new(forecast)) }
}

/// All controllers, in the order of every table: baselines first.
fn controllers(spec: &ControlSpec, checkpoints: &[LoadedCheckpoint]) -> Vec<ControllerInfo> {
    let baselines = spec.baselines.iter().map(|baseline| ControllerInfo {
        name: baseline.as_str().to_owned(),
        kind: PredictorKind::Baseline,
        digest: None,
    });
    let learned = checkpoints.iter().map(|checkpoint| ControllerInfo {
        name: checkpoint.info.name.clone(),
        kind: PredictorKind::Checkpoint,
        digest: checkpoint.info.digest,
    });
    baselines.chain(learned).collect()
}

/// The spec that the robots are drawn from.
fn simulation(attempt: &Attempt, spec: &ControlSpec) -> Result<SimulateSpec, TaskError> {
    let data = TrajectorySource::open(attempt, &spec.data, Given::Torques)?;
    let missing =
        || TaskError::Missing { what: "the simulation of", name: format!("{:?}", spec.data) };
    data.spec().simulation().cloned().ok_or_else(missing)
}

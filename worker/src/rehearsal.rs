//! Rehearsals: estimates the cost of a job on this machine by doing a little of it.

use std::ops::ControlFlow;
use std::time::Instant;

use evaluation::{NominalArm, baseline};
use models::{Device, DeviceKind, ModelError, Sampling, TrainedModel, Trainer, TrainingData};
use series::{Observed, Series, Shape, ShapeError};
use spec::{Baseline, DataSource, DataSpec, Normalization, SamplerSpec, SimulateSpec, TrainSpec};

use crate::error::RehearsalError;

/// A shorter step is measured with its full batch.
const SHORT_SECONDS: f64 = 2.0;
/// Number of optimizer steps taken with each batch.
const STEPS: u32 = 3;
/// Number of passes of a network that are timed together.
const PASSES: u32 = 2;
/// Number of scenarios for a network or a baseline.
const SCENARIOS: usize = 8;
const ROBOTS: u64 = 512;

/// Seconds for the parts of a training.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrainingTimes {
    /// One optimizer step with the spec's batch size.
    pub step: f64,
    /// One pass through the network, per scenario of a batch of several.
    pub pass: f64,
}

/// Seconds for one trajectory of a simulation, on all threads.
///
/// # Errors
/// When the simulation itself fails.
pub fn simulation_seconds(spec: &SimulateSpec) -> Result<f64, RehearsalError> {
    let count = ROBOTS.min(spec.trajectories);
    trajectories(spec, count)?;
    let started = Instant::now();
    trajectories(spec, count)?;
    Ok(started.elapsed().as_secs_f64() / count as f64)
}

/// Takes a few steps of a training on robots of `data`, and makes a few predictions.
///
/// # Errors
/// When the training itself fails. If memory runs out, the system may kill the process instead of
/// returning an error. Therefore few trajectories are computed at once.
pub fn training_times(
    spec: &TrainSpec,
    data: &SimulateSpec,
    device: DeviceKind,
) -> Result<TrainingTimes, RehearsalError> {
    let spec = TrainSpec {
        // This avoids computing the statistics, whose time does not count.
        normalization: Normalization::default_for(&spec.model),
        gradient_accumulation: 1,
        data: DataSource::Stream(Box::new(data.clone())).into(),
        data_weights: None,
        ..spec.clone()
    };
    let device = &Device::open(device)?;
    let full = spec.batch_size as usize;
    let batch = repeated(&trajectories(data, full as u64)?, full)?;
    let training = TrainingData {
        samples: data.samples,
        joints: batch.joints(),
        rate_hz: data.rate_hz,
        statistics: None,
    };
    let mut trainer = Trainer::new(&spec, training, "", device)?;
    let one = step_seconds(&mut trainer, &repeated(&batch, 1)?)?;
    let step = if one * full as f64 <= SHORT_SECONDS || full <= 3 {
        step_seconds(&mut trainer, &batch)?
    } else {
        // The time that each further trajectory adds to the fixed time of a step.
        let three = step_seconds(&mut trainer, &repeated(&batch, 3)?)?;
        one + (three - one).max(0.0) / 2.0 * (full - 1) as f64
    };
    let model = TrainedModel::from_files(&trainer.checkpoint()?, device)?;
    let observed = batch.part(0..full.min(SCENARIOS)).observed(0, model.context());
    Ok(TrainingTimes { step, pass: pass_seconds(&model, &observed)? })
}

/// Seconds per scenario, on all threads.
///
/// # Errors
/// When the simulation of the scenarios fails. A baseline without an answer is timed like any
/// other.
pub fn baseline_seconds(
    name: Baseline,
    data: &SimulateSpec,
    context: u32,
) -> Result<f64, RehearsalError> {
    let scenarios = trajectories(data, SCENARIOS as u64)?;
    let arm = NominalArm::of(&DataSpec::Simulation(data.clone()));
    let predictor = baseline(name, &arm);
    let started = Instant::now();
    let _answer = predictor.predict(&scenarios.observed(context as usize));
    Ok(started.elapsed().as_secs_f64() / scenarios.robots() as f64)
}

fn trajectories(spec: &SimulateSpec, count: u64) -> Result<Series, RehearsalError> {
    let go_on = |_| ControlFlow::Continue(());
    let simulated = dynamics::simulate(spec, 0..count.min(spec.trajectories), &go_on)?;
    Ok(simulated.series)
}

/// Repeats the first trajectories until there are `robots` of them.
fn repeated(series: &Series, robots: usize) -> Result<Series, ShapeError> {
    let shape = Shape { robots, ..series.shape() };
    let values = shape.values()?;
    let repeated = |values_of: &[f32]| values_of.iter().copied().cycle().take(values).collect();
    Series::new(shape, series.rate_hz(), repeated(series.u()), repeated(series.y()))
}

/// The fastest of several steps. The first one allocates memory, and other load may slow the rest.
fn step_seconds(trainer: &mut Trainer, batch: &Series) -> Result<f64, ModelError> {
    let mut fastest = f64::INFINITY;
    for _ in 0..STEPS {
        let started = Instant::now();
        trainer.step(batch)?;
        fastest = fastest.min(started.elapsed().as_secs_f64());
    }
    Ok(fastest)
}

fn pass_seconds(model: &TrainedModel, observed: &Observed<'_>) -> Result<f64, ModelError> {
    let own = model.architecture().sampler();
    let passes = own.map_or(1, |own| own.steps.unwrap_or(PASSES).min(PASSES));
    let sampler = own.map(|own| SamplerSpec { steps: Some(passes), ..*own });
    let sampling = Sampling { sampler, ..Sampling::default() };
    let mut seconds = f64::INFINITY;
    for _ in 0..2 {
        let started = Instant::now();
        if model.is_generative() {
            model.sample(observed, &sampling)?;
        } else {
            model.predict(observed)?;
        }
        seconds = seconds.min(started.elapsed().as_secs_f64());
    }
    Ok(seconds / f64::from(passes) / observed.robots() as f64)
}

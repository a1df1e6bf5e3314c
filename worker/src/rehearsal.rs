//! What a job would take on this machine, from doing a little of it.

use std::ops::ControlFlow;
use std::time::Instant;

use dynamics::{DynamicsError, Trajectories};
use evaluation::{NominalArm, Scenarios, baseline};
use models::{
    Batch, Device, DeviceKind, ModelError, PredictionInput, Sampling, TrainedModel, Trainer,
    TrainingData,
};
use spec::{
    Baseline, DataSource, DataSpec, JOINTS, Normalization, SamplerSpec, SimulateSpec, TrainSpec,
};

use crate::error::RehearsalError;

/// A step that is shorter is taken whole.
const SHORT_SECONDS: f64 = 2.0;
/// Optimizer steps that are taken with each batch.
const STEPS: u32 = 3;
/// Passes of a network whose time is measured at once.
const PASSES: u32 = 2;
/// Scenarios that a network or a baseline is asked about.
const SCENARIOS: usize = 8;
const ROBOTS: u64 = 512;

/// Seconds that a training's parts take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrainingTimes {
    /// Of an optimizer step with the spec's batch.
    pub step: f64,
    /// Of one pass through the network, for one scenario among several.
    pub pass: f64,
}

/// Seconds for one trajectory of a simulation, on all threads.
///
/// # Errors
/// What the simulation itself fails of.
pub fn simulation_seconds(spec: &SimulateSpec) -> Result<f64, RehearsalError> {
    let count = ROBOTS.min(spec.trajectories);
    trajectories(spec, count)?;
    let started = Instant::now();
    trajectories(spec, count)?;
    Ok(started.elapsed().as_secs_f64() / count as f64)
}

/// Takes a few steps of a training, on robots of `data`, and predicts a little.
///
/// # Errors
/// What the training itself fails of; not for want of memory, which the system may answer by
/// ending the process: few trajectories are computed at once.
pub fn training_times(
    spec: &TrainSpec,
    data: &SimulateSpec,
    device: DeviceKind,
) -> Result<TrainingTimes, RehearsalError> {
    let spec = TrainSpec {
        // Saves the statistics, whose time does not count.
        normalization: Normalization::Context,
        gradient_accumulation: 1,
        data: DataSource::Stream(Box::new(data.clone())),
        ..spec.clone()
    };
    let device = &Device::open(device)?;
    let training = TrainingData { samples: data.samples, rate_hz: data.rate_hz, statistics: None };
    let mut trainer = Trainer::new(&spec, training, "", device)?;
    let full = spec.batch_size as usize;
    let batch = batch(data, full)?;
    let one = step_seconds(&mut trainer, &head(&batch, 1))?;
    let step = if one * full as f64 <= SHORT_SECONDS || full <= 3 {
        step_seconds(&mut trainer, &batch)?
    } else {
        // What each trajectory adds to what a step takes anyway.
        let three = step_seconds(&mut trainer, &head(&batch, 3))?;
        one + (three - one).max(0.0) / 2.0 * (full - 1) as f64
    };
    let model = TrainedModel::from_files(&trainer.checkpoint()?, device)?;
    let input = known(&head(&batch, SCENARIOS), model.context());
    Ok(TrainingTimes { step, pass: pass_seconds(&model, &input)? })
}

/// Seconds for one scenario, on all threads.
///
/// # Errors
/// What the simulation of the scenarios fails of. A baseline without an answer took its time, too.
pub fn baseline_seconds(
    name: Baseline,
    data: &SimulateSpec,
    context: u32,
) -> Result<f64, RehearsalError> {
    let simulated = trajectories(data, SCENARIOS as u64)?;
    let arm = NominalArm::of(&DataSpec::Simulation(data.clone()));
    let scenarios = Scenarios {
        size: simulated.count,
        samples: simulated.samples,
        pre_roll: 0,
        rate_hz: data.rate_hz,
        u: simulated.u,
        y: simulated.q,
    };
    let predictor = baseline(name, &arm);
    let started = Instant::now();
    let _answer = predictor.predict(&scenarios.observed(context as usize));
    Ok(started.elapsed().as_secs_f64() / scenarios.size as f64)
}

fn trajectories(spec: &SimulateSpec, count: u64) -> Result<Trajectories, DynamicsError> {
    let go_on = |_| ControlFlow::Continue(());
    dynamics::simulate(spec, 0..count.min(spec.trajectories), &go_on)
}

/// The first trajectories over and over, as many as are asked for.
fn batch(data: &SimulateSpec, size: usize) -> Result<Batch, DynamicsError> {
    let simulated = trajectories(data, size as u64)?;
    let row = simulated.samples * JOINTS;
    let repeated = |values: &[f32]| values.iter().copied().cycle().take(size * row).collect();
    Ok(Batch {
        u: repeated(&simulated.u),
        y: repeated(&simulated.q),
        size,
        samples: simulated.samples,
    })
}

fn head(batch: &Batch, size: usize) -> Batch {
    let size = size.min(batch.size);
    let end = size * batch.samples * JOINTS;
    Batch { u: batch.u[..end].to_vec(), y: batch.y[..end].to_vec(), size, samples: batch.samples }
}

fn known(batch: &Batch, context: usize) -> PredictionInput {
    let trajectories = batch.y.chunks_exact(batch.samples * JOINTS);
    let y_context = trajectories.flat_map(|y| &y[..context * JOINTS]).copied().collect();
    PredictionInput { u: batch.u.clone(), y_context, size: batch.size }
}

/// The fastest of a few: the first one makes memory, and others may be disturbed.
fn step_seconds(trainer: &mut Trainer, batch: &Batch) -> Result<f64, ModelError> {
    let mut fastest = f64::INFINITY;
    for _ in 0..STEPS {
        let started = Instant::now();
        trainer.step(batch)?;
        fastest = fastest.min(started.elapsed().as_secs_f64());
    }
    Ok(fastest)
}

fn pass_seconds(model: &TrainedModel, input: &PredictionInput) -> Result<f64, ModelError> {
    let own = model.architecture().sampler();
    let passes = own.map_or(1, |own| own.steps.unwrap_or(PASSES).min(PASSES));
    let sampler = own.map(|own| SamplerSpec { steps: Some(passes), ..*own });
    let sampling = Sampling { sampler, ..Sampling::default() };
    let mut seconds = f64::INFINITY;
    for _ in 0..2 {
        let started = Instant::now();
        if model.is_generative() {
            model.sample(input, &sampling)?;
        } else {
            model.predict(input)?;
        }
        seconds = seconds.min(started.elapsed().as_secs_f64());
    }
    Ok(seconds / f64::from(passes) / input.size as f64)
}

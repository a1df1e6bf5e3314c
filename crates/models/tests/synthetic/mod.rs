//! Arms that obey q̇ = u / D exactly, and the smallest training that learns from them.

#![allow(dead_code, reason = "each test file uses its own part")]

#[path = "../smallest/mod.rs"]
mod smallest;

use models::TrainingData;
use random::{ChaCha8Rng, Rng, SeedableRng};
use series::{Series, Shape};
use spec::{
    DataSource, Execution, Head, ModelSpec, Normalization, OptimizerSpec, Residual, RoboMorphSpec,
    TrainSpec, ValidationMetric,
};

/// Joints of the Panda.
pub const JOINTS: usize = 7;
pub const SAMPLES: u32 = 24;
pub const CONTEXT: u32 = 16;
pub const DATA: TrainingData =
    TrainingData { samples: SAMPLES, joints: JOINTS, rate_hz: 60.0, statistics: None };

/// A training of a model with some two thousand parameters.
pub fn train_spec() -> TrainSpec {
    TrainSpec {
        data: DataSource::Dataset(1).into(),
        data_weights: None,
        given: spec::Given::Torques,
        init: None,
        frozen: Vec::new(),
        model: ModelSpec::RoboMorph(RoboMorphSpec {
            d_model: 8,
            heads: 2,
            encoder_layers: 1,
            decoder_layers: 1,
            patch: 4,
            mlp_ratio: 2,
            matmul_precision: spec::MatmulPrecision::F32,
            head: Head::Point,
            output: spec::Output::Positions,
            loss: spec::PointLoss::MeanSquare,
            residual: Residual::None,
        }),
        context: CONTEXT,
        normalization: Normalization::Context,
        optimizer: OptimizerSpec {
            learning_rate: 3e-3,
            warmup_steps: 2,
            gradient_clip_norm: Some(1.0),
            weight_decay: 0.01,
            ..OptimizerSpec::default()
        },
        batch_size: 8,
        gradient_accumulation: 1,
        ema: None,
        loss_weights: None,
        steps: 40,
        seed: 7,
        validation_fraction: 0.1,
        validate_every_steps: 10,
        validation_trajectories: 512,
        sampled_trajectories: 64,
        monitor: ValidationMetric::RmseDeg,
        early_stop: None,
        checkpoint_every_steps: Some(10),
        checkpoint_every_seconds: None,
        keep_checkpoints: 2,
        execution: Execution::default(),
    }
}

/// The same training of `model`, with the normalization that it needs.
pub fn training_of(model: ModelSpec) -> TrainSpec {
    TrainSpec { normalization: Normalization::default_for(&model), model, ..train_spec() }
}

/// Batch number `index`, which is always the same.
pub fn batch(index: u64, size: usize) -> Series {
    let samples = SAMPLES as usize;
    let mut generator = ChaCha8Rng::seed_from_u64(index);
    let mut unit = move || generator.next_u32() as f32 / u32::MAX as f32;
    let (mut u, mut y) = (Vec::new(), Vec::new());
    for _ in 0..size {
        let mut position: [f32; JOINTS] = std::array::from_fn(|_| unit() - 0.5);
        let damping: [f32; JOINTS] = std::array::from_fn(|_| 9.0 + 2.0 * unit());
        let amplitude: [f32; JOINTS] = std::array::from_fn(|_| 10.0 * (unit() - 0.5));
        let frequency: [f32; JOINTS] = std::array::from_fn(|_| 0.2 + 0.3 * unit());
        for sample in 0..samples {
            for joint in 0..JOINTS {
                let torque = amplitude[joint] * (frequency[joint] * sample as f32).sin();
                u.push(torque);
                y.push(position[joint]);
                position[joint] += torque / damping[joint] / 60.0;
            }
        }
    }
    let shape = Shape { robots: size, samples, joints: JOINTS };
    Series::new(shape, DATA.rate_hz, u, y).expect("values of this shape")
}

/// The smallest model of every architecture that learns, plain and with each of its options.
pub fn every_kind() -> Vec<(String, ModelSpec)> {
    let models = smallest::models().into_iter();
    models.map(|(name, model)| (name, serde_json::from_value(model).unwrap())).collect()
}

/// The model of [`every_kind`] with this name.
pub fn kind(name: &str) -> ModelSpec {
    serde_json::from_value(smallest::model(name)).unwrap()
}

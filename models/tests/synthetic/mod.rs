//! Arms that obey q̇ = u / D exactly, and the smallest training that can learn from them.

#![allow(dead_code, reason = "each test file uses its own part")]

use models::TrainingData;
use random::{ChaCha8Rng, Rng, SeedableRng};
use series::{Series, Shape};
use spec::{
    CdcnnSpec, CdtSpec, Conditioning, DampedIntegrator, DataSource, DiffuserSpec, DiffusionSpec,
    Execution, FlowPrediction, FlowSpec, Head, Known, ModelSpec, Normalization, OptimizerSpec,
    Prediction, Residual, RoboMorphSpec, SamplerKind, SamplerSpec, TrainSpec, ValidationMetric,
};

/// Joints of the Panda.
const JOINTS: usize = 7;

pub const SAMPLES: u32 = 24;
pub const CONTEXT: u32 = 16;
pub const DATA: TrainingData =
    TrainingData { samples: SAMPLES, joints: JOINTS, rate_hz: 60.0, statistics: None };

/// A training of a model of some two thousand parameters.
pub fn train_spec() -> TrainSpec {
    TrainSpec {
        data: DataSource::Dataset(1),
        model: ModelSpec::RoboMorph(RoboMorphSpec {
            d_model: 8,
            heads: 2,
            encoder_layers: 1,
            decoder_layers: 1,
            patch: 4,
            mlp_ratio: 2,
            head: Head::Point,
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

/// Batch number `index`, always the same.
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

/// A model of every kind, the smallest that can learn.
pub fn every_kind() -> Vec<(&'static str, ModelSpec)> {
    let robomorph = RoboMorphSpec {
        d_model: 16,
        heads: 2,
        encoder_layers: 1,
        decoder_layers: 1,
        patch: 4,
        mlp_ratio: 2,
        head: Head::Point,
        residual: Residual::None,
    };
    let diffusion = DiffusionSpec {
        steps: 20,
        prediction: Prediction::Clean,
        clip: Some(8.0),
        ..DiffusionSpec::default()
    };
    let sampler = SamplerSpec { kind: SamplerKind::Ddim, steps: Some(5), ..SamplerSpec::default() };
    let diffuser = DiffuserSpec {
        width: 16,
        multipliers: vec![1, 2],
        known: Known::CleanAndMasked,
        weights: [1.0, 3.0],
        diffusion,
        sampler,
        residual: Residual::None,
    };
    let cdcnn = CdcnnSpec {
        embedding: 16,
        widths: vec![16, 32],
        conditioning: Conditioning::Local,
        diffusion,
        sampler,
        residual: Residual::None,
    };
    let cdt = CdtSpec {
        d_model: 16,
        heads: 2,
        encoder_layers: 1,
        decoder_layers: 2,
        mlp_ratio: 2,
        dropout: 0.0,
        embedding_dropout: 0.0,
        diffusion,
        sampler,
        residual: Residual::None,
    };
    let flow = FlowSpec {
        embedding: 16,
        widths: vec![16, 32],
        prediction: FlowPrediction::Clean,
        // As many levels for warm starts as the others have.
        warm_start_time: 0.02,
        sampler: SamplerSpec { kind: SamplerKind::Euler, ..SamplerSpec::default() },
        residual: Residual::None,
    };
    let integrator = Residual::Integrator(DampedIntegrator { damping: 7.0 });
    let velocity = DiffusionSpec { prediction: Prediction::Velocity, ..diffusion };
    vec![
        ("robomorph", ModelSpec::RoboMorph(robomorph.clone())),
        ("robomorph, gaussian", {
            ModelSpec::RoboMorph(RoboMorphSpec { head: Head::Gaussian, ..robomorph })
        }),
        ("robomorph, residual", {
            ModelSpec::RoboMorph(RoboMorphSpec { residual: integrator, ..robomorph })
        }),
        ("diffuser", ModelSpec::Diffuser(diffuser.clone())),
        ("diffuser, joint noise", {
            ModelSpec::Diffuser(DiffuserSpec {
                known: Known::JointNoise,
                diffusion: velocity,
                ..diffuser
            })
        }),
        ("cdcnn", ModelSpec::Cdcnn(cdcnn.clone())),
        ("cdcnn, global", {
            ModelSpec::Cdcnn(CdcnnSpec {
                conditioning: Conditioning::Global,
                residual: integrator,
                ..cdcnn
            })
        }),
        ("cdt", ModelSpec::Cdt(cdt.clone())),
        ("cdt, dropout", {
            ModelSpec::Cdt(CdtSpec { dropout: 0.1, embedding_dropout: 0.1, ..cdt })
        }),
        ("flow", ModelSpec::Flow(flow.clone())),
        ("flow, velocity", {
            ModelSpec::Flow(FlowSpec {
                prediction: FlowPrediction::Velocity,
                residual: integrator,
                ..flow
            })
        }),
    ]
}

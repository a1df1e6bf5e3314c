//! The same weights and data give the same numbers here and in PyTorch, forward, backward and
//! through AdamW. `tests/peers/robomorph.py` made the expectations with PyTorch.

use std::path::PathBuf;

use safetensors::SafeTensors;
use spec::{DataSource, Execution, JOINTS, Normalization, OptimizerSpec, TrainSpec};

use crate::checkpoint::{CONFIG_FILE, CheckpointFiles, MODEL_FILE};
use crate::initialization::InitialWeights;
use crate::normalization::{Normalizer, model_input, target};
use crate::optimizer::{ModelOptimizer, NamedGradients};
use crate::parameters::{NamedTensor, NamedTensors, host_values, parameters};
use crate::sequence_model::SequenceModel;
use crate::{
    Batch, CheckpointConfig, Device, PredictionInput, TrainedModel, Trainer, TrainingData,
    checkpoint,
};

fn read(file: &str) -> Vec<u8> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/robomorph");
    std::fs::read(folder.join(file)).unwrap()
}

fn expected(name: &str) -> Vec<f32> {
    let bytes = read("expected.safetensors");
    let parsed = SafeTensors::deserialize(&bytes).unwrap();
    let (numbers, _) = parsed.tensor(name).unwrap().data().as_chunks::<4>();
    numbers.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect()
}

fn config() -> CheckpointConfig {
    CheckpointConfig::parse(&read(CONFIG_FILE)).unwrap()
}

fn batch() -> Batch {
    let (u, y) = (expected("u"), expected("y"));
    let samples = config().samples as usize;
    Batch { size: u.len() / (samples * JOINTS), u, y, samples }
}

/// ‖a - b‖ / ‖b‖.
fn relative_difference(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len());
    let norm = |values: &mut dyn Iterator<Item = f32>| {
        values.map(|value| f64::from(value).powi(2)).sum::<f64>().sqrt()
    };
    norm(&mut a.iter().zip(b).map(|(a, b)| a - b)) / norm(&mut b.iter().copied())
}

#[track_caller]
fn check_close(what: &str, found: &[f32], tolerance: f64) {
    let difference = relative_difference(found, &expected(what));
    assert!(difference <= tolerance, "{what}: {difference:e}");
}

fn loaded(config: &CheckpointConfig, device: &burn::tensor::Device) -> SequenceModel {
    let mut weights = InitialWeights::new(0, device);
    let model =
        SequenceModel::new(&config.model, config.context, config.horizon, &mut weights).unwrap();
    checkpoint::load_weights(model, &read(MODEL_FILE)).unwrap()
}

#[test]
fn predictions_agree() {
    for (name, normalizer) in [("context", Normalizer::Context), ("dataset", config().normalizer)] {
        let config = CheckpointConfig { normalizer, ..config() };
        let json = serde_json::to_vec(&config).unwrap();
        let model = TrainedModel::load(&read(MODEL_FILE), &json, &Device::cpu()).unwrap();
        let batch = batch();
        let PredictionInput { u, y_context, size } = batch.known(model.context());
        let predicted = model.predict(&PredictionInput { u, y_context, size }).unwrap();
        check_close(&format!("prediction.{name}"), &predicted, 1e-5);
    }
}

#[test]
fn gradients_agree() {
    let config = config();
    let device = Device::cpu().training();
    let model = loaded(&config, &device);
    let (context, samples) = (config.context as usize, config.samples as usize);
    let batch = batch();
    let statistics = config.normalizer.statistics_of_batch(&batch, context);
    let input = model_input(&batch.known(context), &statistics, samples, context, &device);
    let error = model.forward(input) - target(&batch, &statistics, context, &device);
    let gradients = NamedGradients::of(&model, error.square().mean().backward()).unwrap();

    let names: Vec<String> = parameters(&model).unwrap().into_keys().collect();
    assert_eq!(gradients.by_name().len(), names.len());
    for name in names {
        let gradient = host_values(gradients.by_name()[&name].clone()).unwrap();
        let expected = expected(&format!("gradient.{name}"));
        if name.ends_with("key.bias") {
            // Softmax is blind to a bias that all keys share: its gradient is zero but for rounding.
            let largest = gradient.iter().chain(&expected).fold(0.0, |a: f32, b| a.max(b.abs()));
            assert!(largest < 1e-6, "{name}: {largest:e}");
        } else {
            check_close(&format!("gradient.{name}"), &gradient, 1e-5);
        }
    }
}

#[test]
fn steps_of_the_optimizer_agree() {
    let config = config();
    let spec = TrainSpec {
        data: DataSource::Dataset(1),
        model: config.model.clone(),
        context: config.context,
        normalization: Normalization::Dataset,
        optimizer: OptimizerSpec {
            learning_rate: 1e-2,
            final_learning_rate_ratio: 0.1,
            warmup_steps: 2,
            betas: [0.9, 0.95],
            // Large, so that gradients near zero do not make steps of random sign.
            epsilon: 1e-3,
            weight_decay: 0.05,
            gradient_clip_norm: Some(0.5),
        },
        batch_size: 3,
        steps: 4,
        seed: 0,
        validation_fraction: 0.1,
        validate_every_steps: 1,
        checkpoint_every_steps: 1,
        execution: Execution::default(),
    };
    let data = TrainingData { samples: config.samples, rate_hz: 60.0, statistics: None };
    let mut trainer =
        Trainer::resume(&spec, data, "pytorch", &untrained(&spec), &Device::cpu()).unwrap();
    for step in 0..4 {
        let report = trainer.step(&batch()).unwrap();
        let loss = f64::from(expected(&format!("loss.{step}"))[0]);
        let norm = f64::from(expected(&format!("gradient_norm.{step}"))[0]);
        assert!((report.loss - loss).abs() < 1e-5 * loss, "{report:?}, expected {loss}");
        assert!((report.gradient_norm - norm).abs() < 1e-5 * norm, "{report:?}, expected {norm}");
    }
    let files = trainer.checkpoint().unwrap();
    let parsed = SafeTensors::deserialize(&files.model).unwrap();
    for (name, view) in parsed.iter() {
        let (numbers, _) = view.data().as_chunks::<4>();
        let found: Vec<f32> = numbers.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect();
        check_close(&format!("after.{name}"), &found, 1e-5);
    }
}

/// PyTorch's weights with the moments of an optimizer that has not stepped.
fn untrained(spec: &TrainSpec) -> CheckpointFiles {
    let model = loaded(&config(), &Device::cpu().training());
    let optimizer = ModelOptimizer::new(&spec.optimizer, &model);
    let state: NamedTensors = optimizer.state(&model).unwrap();
    assert!(state.values().all(|NamedTensor { values, .. }| values.iter().all(|&v| v == 0.0)));
    checkpoint::write(&model, &optimizer, &config()).unwrap()
}

//! The same weights and data give the same numbers here and in PyTorch: the forward pass, every
//! gradient, a step of AdamW, and all steps of a sampler. `tests/peers/*.py` computed the expected
//! numbers with PyTorch, in double precision where gradients are compared.

use std::path::PathBuf;

use burn::tensor::{Tensor, TensorData};
use safetensors::SafeTensors;
use series::{Series, Shape};
use spec::{
    DataSource, Execution, Generation, Lengths, ModelSpec, Normalization, OptimizerSpec,
    SamplerKind, SamplerSpec, TrainSpec, ValidationMetric,
};

use crate::architecture::{Ask, Draw, ModelInput};
use crate::checkpoint::{CONFIG_FILE, CheckpointFiles, MODEL_FILE};
use crate::device::host_values;
use crate::frame::Framing;
use crate::gradient_sum::GradientSum;
use crate::initialization::InitialWeights;
use crate::normalization::{Normalizer, model_input, target};
use crate::optimizer::{ModelOptimizer, NamedGradients};
use crate::parameters::{NamedTensor, NamedTensors, parameters};
use crate::randomness::{Noise, Purpose, generator};
use crate::sequence_model::SequenceModel;
use crate::{CheckpointConfig, Device, TrainedModel, Trainer, TrainingData, checkpoint};

/// Joints of the Panda.
const JOINTS: usize = 7;

/// A folder of `tests/data`.
struct Peer(String);

/// Every folder of `tests/data` with a model for which `is_wanted`.
fn peers(is_wanted: impl Fn(&ModelSpec) -> bool) -> Vec<Peer> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let names =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string());
    let mut peers: Vec<Peer> = names.map(|name| Peer(name.unwrap())).collect();
    peers.retain(|peer| is_wanted(&peer.config().model));
    peers.sort_by(|a, b| a.0.cmp(&b.0));
    peers
}

fn answering_in_one_pass() -> Vec<Peer> {
    peers(|model| model.generation().is_none())
}

fn diffusions() -> Vec<Peer> {
    peers(|model| matches!(model.generation(), Some(Generation::Diffusion(_))))
}

fn flows() -> Vec<Peer> {
    peers(|model| matches!(model.generation(), Some(Generation::Flow(_))))
}

#[test]
fn every_architecture_has_a_peer() {
    for architecture in ModelSpec::ARCHITECTURES {
        let found = peers(|model| model.architecture() == *architecture);
        assert!(
            !found.is_empty(),
            "tests/data has no results of PyTorch for {architecture}; make them with tests/peers"
        );
    }
}

impl Peer {
    fn read(&self, file: &str) -> Vec<u8> {
        let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(&self.0);
        std::fs::read(folder.join(file)).unwrap()
    }

    fn expected(&self, name: &str) -> Vec<f32> {
        let bytes = self.read("expected.safetensors");
        let parsed = SafeTensors::deserialize(&bytes).unwrap();
        let (numbers, _) = parsed.tensor(name).unwrap().data().as_chunks::<4>();
        numbers.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect()
    }

    fn config(&self) -> CheckpointConfig {
        CheckpointConfig::parse(&self.read(CONFIG_FILE)).unwrap()
    }

    fn batch(&self) -> Series {
        let (u, y) = (self.expected("u"), self.expected("y"));
        let CheckpointConfig { samples, rate_hz, .. } = self.config();
        let samples = samples as usize;
        let shape = Shape { robots: u.len() / (samples * JOINTS), samples, joints: JOINTS };
        Series::new(shape, rate_hz, u, y).unwrap()
    }

    fn loaded(&self, device: &burn::tensor::Device) -> SequenceModel {
        let config = self.config();
        let mut weights = InitialWeights::new(0, device);
        let model = SequenceModel::new(&config.model, config.extents(), &mut weights).unwrap();
        checkpoint::load_weights(model, &self.read(MODEL_FILE)).unwrap()
    }

    /// The peer's batch as the input of the model, and y of its horizon.
    fn seen(&self, device: &burn::tensor::Device) -> (ModelInput, Tensor<3>) {
        let config = self.config();
        let context = config.context as usize;
        let batch = self.batch();
        let (batch, known) = (batch.view(), batch.observed(context));
        let statistics = config.normalizer.statistics_of_batch(&batch, context);
        let framing = Framing {
            residual: config.model.residual(),
            samples: batch.samples(),
            context,
            rate_hz: config.rate_hz,
        };
        let frames = framing.frames(&known, &statistics);
        let input = model_input(&known, &statistics, &frames, device);
        (input, target(&batch, &frames, context, device))
    }

    #[track_caller]
    fn check_close(&self, what: &str, found: &[f32], tolerance: f64) {
        let difference = relative_difference(found, &self.expected(what));
        assert!(difference <= tolerance, "{} {what}: {difference:e}", self.0);
    }
}

/// ‖a - b‖ / ‖b‖.
fn relative_difference(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len());
    let norm = |values: &mut dyn Iterator<Item = f32>| {
        values.map(|value| f64::from(value).powi(2)).sum::<f64>().sqrt()
    };
    norm(&mut a.iter().zip(b).map(|(a, b)| a - b)) / norm(&mut b.iter().copied())
}

#[test]
fn predictions_in_one_pass_agree() {
    for peer in answering_in_one_pass() {
        let CheckpointConfig { model, normalizer, .. } = peer.config();
        let normalizers = if model.is_physical() {
            vec![("none", normalizer)]
        } else {
            vec![("context", Normalizer::Context), ("dataset", normalizer)]
        };
        for (name, normalizer) in normalizers {
            let config = CheckpointConfig { normalizer, ..peer.config() };
            let json = serde_json::to_vec(&config).unwrap();
            let model = TrainedModel::load(&peer.read(MODEL_FILE), &json, &Device::cpu()).unwrap();
            let predicted = model.predict(&peer.batch().observed(model.context())).unwrap();
            peer.check_close(&format!("prediction.{name}"), &predicted, 1e-5);
        }
    }
}

#[test]
fn answers_to_shorter_questions_agree() {
    let peers = peers(|model| matches!(model.lengths(), Lengths::From(_)));
    assert!(!peers.is_empty());
    for peer in peers {
        let config = peer.config();
        let Lengths::From(least) = config.model.lengths() else { continue };
        let json = peer.read(CONFIG_FILE);
        let model = TrainedModel::load(&peer.read(MODEL_FILE), &json, &Device::cpu()).unwrap();
        let end = (config.samples - config.model.patch()) as usize;
        let batch = peer.batch();
        let asked = batch.view().window(0..end).observed(0, least as usize);
        peer.check_close("prediction.shorter", &model.predict(&asked).unwrap(), 1e-5);
    }
}

#[track_caller]
fn check_gradients(peer: &Peer, model: &SequenceModel, gradients: &NamedGradients) {
    let names: Vec<String> = parameters(model).unwrap().into_keys().collect();
    assert_eq!(gradients.by_name().len(), names.len());
    for name in names {
        let gradient = host_values(gradients.by_name()[&name].clone()).unwrap();
        let expected = peer.expected(&format!("gradient.{name}"));
        let largest = |values: &[f32]| values.iter().fold(0.0, |a: f32, b| a.max(b.abs()));
        if largest(&expected) < 1e-12 {
            // Softmax ignores a bias that all keys share, and a normalization of single channels
            // ignores the bias before it. Their gradient is zero up to rounding, here and in
            // PyTorch.
            let blind = name.ends_with("key.bias") || name.ends_with("conv.bias");
            assert!(blind && largest(&gradient) < 1e-6, "{name}: {:e}", largest(&gradient));
        } else {
            peer.check_close(&format!("gradient.{name}"), &gradient, tolerance(&name));
        }
    }
}

#[test]
fn gradients_of_models_that_answer_in_one_pass_agree() {
    for peer in answering_in_one_pass() {
        let device = Device::cpu().training();
        let model = peer.loaded(&device);
        let (input, target) = peer.seen(&device);
        // The random numbers of a training's second step: peers/one_pass.py says why.
        let rows = 0..peer.batch().robots() as u64;
        let rows = rows.map(|row| generator(0, Purpose::Training, 2, row));
        let loss = model.loss(input, target, &mut Noise::new(rows));
        let gradients = GradientSum::of(&model, 0.0, loss.tensor().backward()).named().unwrap();
        check_gradients(&peer, &model, &gradients);
    }
}

#[test]
fn steps_of_the_optimizer_agree() {
    for peer in answering_in_one_pass() {
        check_optimizer_steps(&peer);
    }
}

fn check_optimizer_steps(peer: &Peer) {
    let config = peer.config();
    let normalization = match config.normalizer {
        Normalizer::None => Normalization::None,
        _ => Normalization::Dataset,
    };
    let spec = TrainSpec {
        data: DataSource::Dataset(1).into(),
        data_weights: None,
        given: spec::Given::Torques,
        init: None,
        frozen: Vec::new(),
        model: config.model.clone(),
        context: config.context,
        normalization,
        optimizer: OptimizerSpec {
            learning_rate: 1e-2,
            final_learning_rate_ratio: 0.1,
            warmup_steps: 2,
            betas: [0.9, 0.95],
            // Epsilon is large, so that gradients near zero do not make steps of random sign.
            epsilon: 1e-3,
            weight_decay: 0.05,
            gradient_clip_norm: Some(0.5),
        },
        batch_size: 3,
        gradient_accumulation: 1,
        ema: None,
        loss_weights: None,
        steps: 4,
        seed: 0,
        validation_fraction: 0.1,
        validate_every_steps: 1,
        validation_trajectories: 512,
        sampled_trajectories: 64,
        monitor: ValidationMetric::RmseDeg,
        early_stop: None,
        checkpoint_every_steps: Some(1),
        checkpoint_every_seconds: None,
        keep_checkpoints: 1,
        execution: Execution::default(),
    };
    let data = TrainingData {
        samples: config.samples,
        joints: config.joints,
        rate_hz: 60.0,
        statistics: None,
    };
    let mut trainer =
        Trainer::resume(&spec, data, "pytorch", &untrained(peer, &spec), &Device::cpu()).unwrap();
    // The loss includes the score of draws.
    let tolerance_of_loss = if spec.model.is_physical() { tolerance("doubt") } else { 1e-5 };
    for step in 0..4 {
        let report = trainer.step(&peer.batch()).unwrap();
        let loss = f64::from(peer.expected(&format!("loss.{step}"))[0]);
        let norm = f64::from(peer.expected(&format!("gradient_norm.{step}"))[0]);
        let off = [(report.loss - loss) / loss, (report.gradient_norm - norm) / norm].map(f64::abs);
        assert!(off.into_iter().all(|off| off < tolerance_of_loss), "{report:?}: {loss} {norm}");
    }
    let files = trainer.checkpoint().unwrap();
    let parsed = SafeTensors::deserialize(&files.model).unwrap();
    for (name, view) in parsed.iter() {
        let (numbers, _) = view.data().as_chunks::<4>();
        let found: Vec<f32> = numbers.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect();
        peer.check_close(&format!("after.{name}"), &found, tolerance(name));
    }
}

/// The tolerance of a parameter's gradient. The draws that train `doubt` are rolled out in single
/// precision.
fn tolerance(parameter: &str) -> f64 {
    if parameter == "doubt" { 1e-4 } else { 1e-5 }
}

/// PyTorch's weights with the moments of an optimizer that has not stepped.
fn untrained(peer: &Peer, spec: &TrainSpec) -> CheckpointFiles {
    let model = peer.loaded(&Device::cpu().training());
    let optimizer = ModelOptimizer::new(&spec.optimizer, &model);
    let state: NamedTensors = optimizer.state(&model).unwrap();
    assert!(state.values().all(|NamedTensor { values, .. }| values.iter().all(|&v| v == 0.0)));
    checkpoint::write(&model, None, &optimizer, &peer.config()).unwrap()
}

fn series(peer: &Peer, name: &str, device: &burn::tensor::Device) -> Tensor<3> {
    let values = peer.expected(name);
    let Shape { robots: size, samples, .. } = peer.batch().shape();
    let channels = values.len() / (size * samples);
    Tensor::from_data(TensorData::new(values, [size, samples, channels]), device)
}

/// Compares the answers to a noisy series at levels 3, 17 and 0, then the gradients of their
/// squared error, and a step of Adam along these.
#[test]
fn denoisers_answer_and_learn_alike() {
    for peer in peers(|model| model.generation().is_some()) {
        let device = Device::cpu().training();
        let model = peer.loaded(&device);
        let (input, _) = peer.seen(&device);
        let noisy = series(&peer, "noisy", &device);
        let answer = model.answer_to_noise(noisy, &[3, 17, 0], &input).unwrap();
        peer.check_close("answer", &host_values(answer.clone().inner()).unwrap(), 1e-5);

        let error = answer - series(&peer, "answer_wanted", &device);
        let gradients = error.square().mean().backward();
        let gradients = GradientSum::of(&model, 0.0, gradients).named().unwrap();
        check_gradients(&peer, &model, &gradients);

        // Epsilon is large, so that gradients near zero do not make steps of random sign.
        let spec = OptimizerSpec { epsilon: 1e-3, ..OptimizerSpec::default() };
        let stepped = ModelOptimizer::new(&spec, &model).step(model, gradients, 1e-2);
        for (name, tensor) in parameters(&stepped).unwrap() {
            peer.check_close(&format!("after.{name}"), &tensor.values, 1e-5);
        }
    }
}

#[test]
fn whole_chains_of_samplers_agree() {
    for peer in diffusions() {
        let device = Device::cpu().inference();
        let model = peer.loaded(&device);
        for (name, kind, steps) in [
            ("ddim", SamplerKind::Ddim, None),
            ("ddim_7", SamplerKind::Ddim, Some(7)),
            ("dpm_solver_7", SamplerKind::DpmSolver, Some(7)),
        ] {
            check_chain(&peer, &model, name, kind, steps);
        }
        let chunk = peer.expected("noise").len();
        let all = peer.expected("ddpm_noise");
        let noise = Noise::given(all.chunks(chunk).map(<[f32]>::to_vec));
        let found = chain(&peer, &model, &SamplerSpec::default(), noise);
        peer.check_close("chain.ddpm", &found, 1e-4);
    }
}

#[test]
fn whole_chains_of_flows_agree() {
    for peer in flows() {
        let model = peer.loaded(&Device::cpu().inference());
        for (name, kind, steps) in [
            ("euler_1", SamplerKind::Euler, 1),
            ("euler_4", SamplerKind::Euler, 4),
            ("heun_3", SamplerKind::Heun, 3),
        ] {
            check_chain(&peer, &model, name, kind, Some(steps));
        }
    }
}

/// Checks a chain whose only noise is the initial one.
#[track_caller]
fn check_chain(
    peer: &Peer,
    model: &SequenceModel,
    name: &str,
    kind: SamplerKind,
    steps: Option<u32>,
) {
    let sampler = SamplerSpec { kind, steps, ..SamplerSpec::default() };
    let found = chain(peer, model, &sampler, Noise::given([peer.expected("noise")]));
    peer.check_close(&format!("chain.{name}"), &found, 1e-4);
}

fn chain(peer: &Peer, model: &SequenceModel, sampler: &SamplerSpec, mut noise: Noise) -> Vec<f32> {
    let steps = model.process().unwrap().steps(sampler, None);
    let (input, _) = peer.seen(&Device::cpu().inference());
    let ask = Ask { steps: &steps, warm: None, noise: &mut noise, draw: Draw::Mean, behind: 0 };
    host_values(model.answer(input, ask)).unwrap()
}

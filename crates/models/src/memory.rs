//! An estimate of the memory that a training needs, before it begins.

use spec::{DataSpec, Doubt, ModelSpec, TrainSpec};

use crate::architecture::Extents;
use crate::initialization::InitialWeights;
use crate::micro_batches::{MicroBatches, MicroBatching};
use crate::parameters::for_each_parameter;
use crate::sequence_model::SequenceModel;
use crate::{Device, DeviceKind, ModelError};

const F32: u64 = 4;

/// Copies of the parameters during a step: weights, gradients, both moments.
const COPIES: u64 = 4;
/// Copies of the parameters while a checkpoint is made: weights and both moments as tensors, as
/// lists of numbers and as the bytes of files, and the remains of the last step.
const COPIES_OF_A_CHECKPOINT: u64 = 10;

/// Program, threads, and batches that are read ahead.
const BASE: u64 = 120 << 20;

/// The memory that the allocator holds in addition, in tenths of the memory in use.
const HELD_BACK: u64 = 1;

/// The number of parameters of a model of `spec`. No parameter is allocated.
pub(crate) fn parameter_count(spec: &ModelSpec, extents: Extents) -> Result<u64, ModelError> {
    Ok(parameters_of(&without_weights(spec, extents)?))
}

fn without_weights(spec: &ModelSpec, extents: Extents) -> Result<SequenceModel, ModelError> {
    let device = Device::cpu().inference();
    SequenceModel::new(spec, extents, &mut InitialWeights::none(&device))
}

pub(crate) fn parameters_of(model: &SequenceModel) -> u64 {
    let mut numbers = 0;
    for_each_parameter(model, |_, parameter| {
        numbers += parameter.shape().iter().product::<usize>() as u64;
    });
    numbers
}

/// An estimate of the largest memory of a training.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TrainingMemory {
    /// Number of parameters.
    pub parameters: u64,
    /// Bytes that follow from the parameters: weights, gradients, moments, averages.
    pub state_bytes: u64,
    /// Bytes of the activations that a step keeps for the trajectories that it computes together.
    pub activation_bytes: u64,
    /// The largest resident memory of the process.
    pub peak_bytes: u64,
}

impl TrainingMemory {
    /// The memory of a training on trajectories of `samples` of an arm with `joints`, on the CPU.
    ///
    /// # Errors
    /// Sizes that do not fit each other.
    pub fn of(spec: &TrainSpec, samples: u32, joints: usize) -> Result<Self, ModelError> {
        Ok(Counts::of(spec, samples, joints)?.memory(spec, spec.gradient_accumulation))
    }
}

/// The sizes of a model.
struct Counts {
    parameters: u64,
    /// Numbers that a step keeps of one trajectory for the backward pass.
    kept: u64,
    /// The largest temporary buffer of a micro-batch, whatever its size, in numbers.
    scratch: u64,
}

impl Counts {
    fn of(spec: &TrainSpec, samples: u32, joints: usize) -> Result<Self, ModelError> {
        let extents = Extents::new(spec.context, samples, joints)?;
        let model = without_weights(&spec.model, extents)?;
        let mut scratch = 0;
        for_each_parameter(&model, |_, parameter| {
            if let Ok(kernel) = parameter.shape().try_into() {
                scratch = scratch.max(kernels::scratch_of_conv1d(kernel));
            }
        });
        let (kept, scratch) = (model.kept(extents) as u64, scratch as u64);
        Ok(Self { parameters: parameters_of(&model), kept, scratch })
    }

    /// The micro-batches of a batch with a `gradient_accumulation` of `accumulation`, on the processor.
    fn divided(&self, spec: &TrainSpec, accumulation: u32) -> MicroBatches {
        MicroBatching::new(spec, accumulation, self.parameters, DeviceKind::Cpu)
            .of_batch(spec.batch_size as usize)
    }

    /// The memory with a `gradient_accumulation` of `parts`, with this process's threads.
    fn memory(&self, spec: &TrainSpec, parts: u32) -> TrainingMemory {
        let divided = self.divided(spec, parts);
        let at_once = divided.trajectories_at_once() as u64;
        let average = u64::from(spec.ema.is_some());
        // The gradients of micro-batches are added to a sum.
        let sums = if divided.count > 1 { divided.at_once as u64 } else { 0 };
        let of_parameters = |copies: u64| copies * self.parameters * F32;
        let state_bytes = of_parameters(COPIES + average + sums);
        let activation_bytes = at_once * self.kept * F32;
        let used = (state_bytes + activation_bytes)
            .max(of_parameters(COPIES_OF_A_CHECKPOINT + 3 * average))
            + divided.at_once as u64 * self.scratch * F32;
        TrainingMemory {
            parameters: self.parameters,
            state_bytes,
            activation_bytes,
            peak_bytes: BASE + used + used / 10 * HELD_BACK,
        }
    }
}

/// The reason why a training on `data` may not fit into `available` bytes. It is `None` for a model
/// that cannot be built, since the training itself reports that.
pub fn memory_doubt(spec: &TrainSpec, data: &DataSpec, available: u64) -> Option<Doubt> {
    let counts = Counts::of(spec, data.samples(), data.joints()).ok()?;
    let needed = counts.memory(spec, spec.gradient_accumulation);
    if needed.peak_bytes <= available {
        return None;
    }
    let enough = (1..=spec.batch_size)
        .filter(|parts| spec.batch_size.is_multiple_of(*parts))
        .find(|&parts| counts.memory(spec, parts).peak_bytes <= available);
    let advice = match enough {
        Some(parts) => format!(
            "with \"gradient_accumulation\": {parts} it needs about {}, and takes the same steps",
            gigabytes(counts.memory(spec, parts).peak_bytes)
        ),
        None => "no gradient_accumulation makes it fit; use a smaller model".to_owned(),
    };
    Some(Doubt {
        field: "batch_size".to_owned(),
        value: format!(
            "{}, {} at a time",
            spec.batch_size,
            counts.divided(spec, spec.gradient_accumulation).trajectories_at_once()
        ),
        reason: format!(
            "the training needs about {} of memory: {} for its {} parameters and {} for a step; \
             the server's machine has {}, and the system may end a worker that has no more; {advice}",
            gigabytes(needed.peak_bytes),
            gigabytes(needed.state_bytes),
            needed.parameters,
            gigabytes(needed.activation_bytes),
            gigabytes(available),
        ),
    })
}

#[expect(clippy::cast_precision_loss, reason = "two digits are shown")]
fn gigabytes(bytes: u64) -> String {
    format!("{:.2} GiB", bytes as f64 / f64::from(1 << 30))
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};
    use spec::JobSpec;

    use super::*;

    use crate::allocations::live_bytes;
    use crate::architecture::ModelInput;
    use crate::parameters::parameters;
    use crate::randomness::{Noise, Purpose, generator};
    use burn::tensor::{Tensor, TensorData};

    const JOINTS: usize = 7;
    const EXTENTS: Extents = Extents { context: 320, horizon: 80, joints: JOINTS };

    fn training(preset: &str, more: &Value) -> TrainSpec {
        let mut model = json!({"preset": preset});
        for (key, value) in more.as_object().unwrap() {
            model[key] = value.clone();
        }
        let job = json!({
            "kind": "train", "data": {"dataset": 1}, "model": model, "steps": 1, "batch_size": 32,
        });
        match spec::parse(job.to_string().as_bytes()).unwrap() {
            JobSpec::Train(train) => train,
            other => panic!("{other:?}"),
        }
    }

    /// A model of every architecture at two sizes, with every option that changes the computation.
    fn every_kind() -> Vec<(String, TrainSpec)> {
        let transformer = json!({
            "d_model": 48, "heads": 4, "encoder_layers": 3, "decoder_layers": 2, "mlp_ratio": 3,
        });
        let options = [
            ("robomorph", json!({"head": "gaussian"})),
            ("robomorph", json!({"residual": "none", "output": "positions"})),
            ("robomorph", transformer.clone()),
            ("diffuser", json!({"known": "joint-noise"})),
            ("diffuser", json!({"residual": "none"})),
            ("diffuser", json!({"width": 24, "multipliers": [1, 3, 2]})),
            ("cdcnn", json!({"conditioning": "global"})),
            ("cdcnn", json!({"widths": [24, 24, 64], "embedding": 20})),
            ("flow", json!({"widths": [24, 40], "embedding": 20})),
            ("cdt", json!({"dropout": 0.1, "embedding_dropout": 0.1})),
            ("cdt", json!({"objective": "regression", "patch": 5})),
            ("cdt", transformer),
            ("prefix-transformer", json!({"d_model": 48, "heads": 4, "layers": 3, "patch": 8})),
            ("gru", json!({"hidden": 40, "layers": 3, "patch": 8})),
            ("lagrangian", json!({"width": 20, "layers": 3, "forces": 0, "turns_freely": false})),
            ("lagrangian", json!({"rotor_inertia": true, "torque_offset": true})),
            ("lagrangian", json!({"robot": {"model": "panda"}, "rotor_inertia": true})),
        ];
        let plain = ModelSpec::ARCHITECTURES.iter().map(|name| (*name, json!({})));
        let all = plain.chain(options);
        all.map(|(name, more)| (format!("{name} {more}"), training(&format!("{name}-tiny"), &more)))
            .collect()
    }

    #[test]
    fn models_have_the_parameters_that_they_are_said_to_have() {
        let device = Device::cpu().inference();
        for (name, spec) in every_kind() {
            let mut weights = InitialWeights::new(0, &device);
            let model = SequenceModel::new(&spec.model, EXTENTS, &mut weights).unwrap();
            let found: usize =
                parameters(&model).unwrap().values().map(|tensor| tensor.values.len()).sum();
            assert_eq!(found as u64, parameter_count(&spec.model, EXTENTS).unwrap(), "{name}");
        }
    }

    /// The parameter counts follow from the published sizes. CDCNN leaves out its block without
    /// effect, 0.1 M.
    #[test]
    fn at_the_papers_sizes_there_are_as_many_parameters() {
        for (name, more, millions) in [
            ("robomorph-paper", json!({}), 49.9),
            ("diffuser-paper", json!({}), 63.1),
            ("cdcnn-paper", json!({}), 16.6),
            ("cdcnn-paper", json!({"conditioning": "global", "residual": "none"}), 36.4),
            ("cdt-paper", json!({}), 35.8),
            ("flow-paper", json!({}), 16.4),
        ] {
            let count = parameter_count(&training(name, &more).model, EXTENTS).unwrap();
            let found = count as f64 / 1e6;
            assert!((found / millions - 1.0).abs() < 0.01, "{name} {more}: {found} M");
        }
    }

    /// A forward pass keeps as much memory as was counted, and the same for each trajectory.
    #[test]
    fn a_step_keeps_what_is_counted_of_every_architecture() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let mut off = Vec::new();
        for (name, spec) in every_kind() {
            let counted = Counts::of(&spec, 400, JOINTS).unwrap().kept as f64;
            let kept = pool.install(|| {
                let device = Device::cpu().training();
                let mut weights = InitialWeights::new(0, &device);
                let model = SequenceModel::new(&spec.model, EXTENTS, &mut weights).unwrap();
                // The first pass creates what later operations reuse. Some passes grow tables of
                // burn. The pass that leaves least does not.
                kept_bytes(&model, 20);
                let least = |batch| (0..3).map(|_| kept_bytes(&model, batch)).min().unwrap();
                let [few, many] = [4, 20].map(least);
                (many - few) as f64 / 16.0 / F32 as f64
            });
            println!("{name}: {counted} counted, {kept} kept");
            off.extend((counted / kept - 1.0).abs().gt(&0.01).then_some((name, counted, kept)));
        }
        assert!(off.is_empty(), "{off:?}");
    }

    /// Bytes that a forward pass adds to the memory in use.
    fn kept_bytes(model: &SequenceModel, batch: usize) -> isize {
        let before = live_bytes();
        let series = |samples: u32| {
            let shape = [batch, samples as usize, JOINTS];
            let count = shape.iter().product();
            let values: Vec<f32> = (0..count).map(|index| (0.1 * index as f32).sin()).collect();
            Tensor::<3>::from_data(TensorData::new(values, shape), &Device::cpu().training())
        };
        let input = ModelInput {
            u: series(400),
            y_context: series(EXTENTS.context),
            seen_context: series(EXTENTS.context),
            path: series(400),
            unit: series(400),
            rate_hz: 60.0,
            measurement_noise: series::MeasurementNoise::default(),
        };
        let rows = |purpose| (0..batch as u64).map(move |row| generator(0, purpose, 0, row));
        let mut noise = Noise::new(rows(Purpose::Training)).with_dropout(rows(Purpose::Dropout));
        let loss = model.loss(input, series(EXTENTS.horizon), &mut noise);
        let mean = loss.tensor();
        drop(noise);
        let kept = live_bytes() - before;
        drop((loss, mean));
        kept
    }

    #[test]
    fn an_arm_of_fewer_joints_needs_less_memory() {
        let spec = training("robomorph-tiny", &json!({}));
        let [six, seven] = [6, 7].map(|joints| TrainingMemory::of(&spec, 400, joints).unwrap());
        assert!(six.parameters < seven.parameters, "{six:?} {seven:?}");
        assert!(six.activation_bytes < seven.activation_bytes, "{six:?} {seven:?}");
    }

    #[test]
    fn the_advice_of_a_doubt_is_followed_and_the_doubt_is_gone() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
        pool.install(check_advice);
    }

    fn check_advice() {
        let data = spec::parse(br#"{"preset": "D1-chirp"}"#).unwrap();
        let data = DataSpec::of(&data).unwrap();
        let large = TrainSpec { batch_size: 64, ..training("cdt-small", &json!({})) };
        let small = TrainSpec { batch_size: 64, ..training("cdt-tiny", &json!({})) };
        assert_eq!(memory_doubt(&small, &data, 1 << 29), None);
        let Doubt { field, value, reason } = memory_doubt(&large, &data, 1 << 29).unwrap();
        assert_eq!((field.as_str(), value.as_str()), ("batch_size", "64, 32 at a time"));
        for part in ["parameters", "has 0.50 GiB", "a worker"] {
            assert!(reason.contains(part), "{reason:?} lacks {part:?}");
        }
        let (_, advice) = reason.split_once("\"gradient_accumulation\": ").unwrap();
        let parts: u32 = advice.split(' ').next().unwrap().parse().unwrap();
        let split = TrainSpec { gradient_accumulation: parts, ..large };
        assert_eq!(memory_doubt(&split, &data, 1 << 29), None);

        let too_large = training("diffuser-paper", &json!({}));
        let doubt = memory_doubt(&too_large, &data, 1 << 30).unwrap();
        assert!(doubt.reason.contains("use a smaller model"), "{}", doubt.reason);
    }
}

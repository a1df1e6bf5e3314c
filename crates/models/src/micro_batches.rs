//! The division of a training batch into micro-batches.

use spec::{ModelSpec, TrainSpec};

use crate::device::DeviceKind;

/// Trajectories of a Transformer's micro-batch on the processor. Their activations stay in a core's
/// caches from one operation to the next.
const TRAJECTORIES: usize = 16;

/// The same of U-Nets. The tiles of their convolutions are computed anew for each micro-batch, so
/// that smaller ones are slower.
const TRAJECTORIES_OF_U_NETS: usize = 32;

/// Parameters from which all threads compute one micro-batch after the other. Its operations are
/// large enough for all of them, and each micro-batch that is computed at the same time would need
/// gradients and activations of its own.
const LARGE: u64 = 1 << 23;

/// Parameters from which a U-Net's batch is not divided. A step of `diffuser-paper` took more memory
/// and more time in two micro-batches than in one.
const LARGE_U_NET: u64 = 1 << 25;

/// How a training divides its batches. It follows from the spec alone, because the rounding errors
/// of gradients follow from it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MicroBatching {
    /// Largest number of trajectories of a micro-batch.
    pub size: usize,
    /// Micro-batches that may be computed at the same time.
    most_at_once: usize,
}

/// The micro-batches of one batch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MicroBatches {
    /// Trajectories of a micro-batch. The last one may have fewer.
    pub size: usize,
    pub count: usize,
    /// Micro-batches that are computed at the same time.
    pub at_once: usize,
}

impl MicroBatches {
    pub fn trajectories_at_once(self) -> usize {
        self.size * self.at_once
    }
}

impl MicroBatching {
    /// The division of batches that are computed in `accumulation` parts, one after the other, with
    /// a model of so many parameters.
    pub fn new(spec: &TrainSpec, accumulation: u32, parameters: u64, kind: DeviceKind) -> Self {
        let share = spec.batch_size.div_ceil(accumulation.max(1)).max(1) as usize;
        // A GPU is faster with large batches.
        let most = match kind {
            DeviceKind::Cpu => most_trajectories(&spec.model, parameters),
            _ => usize::MAX,
        };
        let count = share.div_ceil(most);
        let most_at_once = if parameters < LARGE { count } else { 1 };
        Self { size: share.div_ceil(count), most_at_once }
    }

    pub fn of_batch(self, trajectories: usize) -> MicroBatches {
        let count = trajectories.div_ceil(self.size).max(1);
        let threads = rayon::current_num_threads();
        let at_once = self.most_at_once.min(threads).min(count);
        MicroBatches { size: self.size, count, at_once }
    }
}

/// The largest number of trajectories of a micro-batch on the processor.
fn most_trajectories(model: &ModelSpec, parameters: u64) -> usize {
    match model {
        ModelSpec::Diffuser(_) | ModelSpec::Cdcnn(_) | ModelSpec::Flow(_)
            if parameters < LARGE_U_NET =>
        {
            TRAJECTORIES_OF_U_NETS
        }
        ModelSpec::Diffuser(_) | ModelSpec::Cdcnn(_) | ModelSpec::Flow(_) => usize::MAX,
        _ => TRAJECTORIES,
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;
    use spec::{JobSpec, TrainSpec};

    use super::{MicroBatches, MicroBatching};
    use crate::device::DeviceKind;

    const FEW: u64 = 1000;

    fn training(preset: &str, gradient_accumulation: u32) -> TrainSpec {
        let job = json!({
            "kind": "train", "data": {"dataset": 1}, "model": {"preset": preset}, "steps": 1,
            "batch_size": 64, "gradient_accumulation": gradient_accumulation,
        });
        let JobSpec::Train(spec) = spec::parse(job.to_string().as_bytes()).unwrap() else {
            panic!("not a training")
        };
        spec
    }

    fn micro_batches(
        preset: &str,
        accumulation: u32,
        parameters: u64,
        threads: usize,
    ) -> MicroBatches {
        micro_batches_on(DeviceKind::Cpu, preset, accumulation, parameters, threads)
    }

    fn micro_batches_on(
        kind: DeviceKind,
        preset: &str,
        accumulation: u32,
        parameters: u64,
        threads: usize,
    ) -> MicroBatches {
        let spec = training(preset, accumulation);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| MicroBatching::new(&spec, accumulation, parameters, kind).of_batch(64))
    }

    #[test]
    fn micro_batches_have_the_same_size_on_any_number_of_threads() {
        for (preset, size) in [("robomorph-tiny", 16), ("cdt-tiny", 16), ("diffuser-tiny", 32)] {
            for threads in [1, 2, 8] {
                let count = 64 / size;
                let expected = MicroBatches { size, count, at_once: threads.min(count) };
                assert_eq!(micro_batches(preset, 1, FEW, threads), expected);
            }
        }
    }

    #[test]
    fn those_of_large_models_are_computed_one_after_the_other() {
        let expected = MicroBatches { size: 16, count: 4, at_once: 1 };
        assert_eq!(micro_batches("cdt-paper", 1, 40_000_000, 8), expected);
        let expected = MicroBatches { size: 32, count: 2, at_once: 1 };
        assert_eq!(micro_batches("cdcnn-paper", 1, 17_000_000, 8), expected);
        let expected = MicroBatches { size: 64, count: 1, at_once: 1 };
        assert_eq!(micro_batches("diffuser-paper", 1, 63_000_000, 8), expected);
    }

    #[test]
    fn no_more_trajectories_are_computed_at_once_than_accumulation_allows() {
        let of = |accumulation| micro_batches("cdt-tiny", accumulation, FEW, 8);
        assert_eq!(of(2), MicroBatches { size: 16, count: 4, at_once: 2 });
        assert_eq!(of(4), MicroBatches { size: 16, count: 4, at_once: 1 });
        assert_eq!(of(16), MicroBatches { size: 4, count: 16, at_once: 1 });
    }

    #[test]
    fn a_batch_is_divided_evenly() {
        let training = |batch_size| TrainSpec { batch_size, ..training("cdt-tiny", 1) };
        let of = |batch: u32| {
            let division = MicroBatching::new(&training(batch), 1, FEW, DeviceKind::Cpu);
            let MicroBatches { size, count, .. } = division.of_batch(batch as usize);
            (size, count)
        };
        assert_eq!([1, 16, 17, 40].map(of), [(1, 1), (16, 1), (9, 2), (14, 3)]);
    }

    #[test]
    fn a_gpu_computes_whole_batches() {
        let of = |accumulation| micro_batches_on(DeviceKind::Gpu, "cdt-tiny", accumulation, FEW, 8);
        assert_eq!(of(1), MicroBatches { size: 64, count: 1, at_once: 1 });
        assert_eq!(of(4), MicroBatches { size: 16, count: 4, at_once: 1 });
    }
}

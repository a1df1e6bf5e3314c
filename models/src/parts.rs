//! The division of a training batch into parts.

use spec::{ModelSpec, TrainSpec};

use crate::device::DeviceKind;

/// Trajectories of a part of a Transformer on the processor. Their activations stay in a core's
/// caches from one operation to the next.
const TOGETHER: usize = 16;

/// The same of U-Nets. The tiles of their convolutions are computed anew for each part, so that
/// smaller parts are slower.
const TOGETHER_IN_U_NETS: usize = 32;

/// Parameters from which all threads compute one part after the other. Gradients of so many would
/// take more memory, for each part that is computed, than a part's activations.
const LARGE: u64 = 1 << 23;

/// Parameters from which a U-Net's batch is not divided. Its gradients take more memory than half
/// of its activations, and its convolutions' tiles would be computed twice.
const LARGE_U_NET: u64 = 1 << 25;

/// How a training divides its batches. The parts follow from the spec alone, because the rounding
/// errors of gradients follow from them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct PartsSpec {
    /// Trajectories of a part.
    pub size: usize,
    /// Parts that may be computed at the same time.
    most_at_once: usize,
}

/// The parts of one batch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Parts {
    /// Trajectories of a part. The last one may have fewer.
    pub size: usize,
    pub count: usize,
    /// Parts that are computed at the same time.
    pub at_once: usize,
}

impl Parts {
    pub fn trajectories_at_once(self) -> usize {
        self.size * self.at_once
    }
}

impl PartsSpec {
    /// The division of batches that are computed in `accumulation` parts, one after the other, with
    /// a model of so many parameters.
    pub fn new(spec: &TrainSpec, accumulation: u32, parameters: u64, kind: DeviceKind) -> Self {
        let share = spec.batch_size.div_ceil(accumulation.max(1)).max(1) as usize;
        // A GPU is faster with large parts.
        let size = match kind {
            DeviceKind::Cpu => together(&spec.model, parameters).min(share),
            _ => share,
        };
        let most_at_once = if parameters < LARGE { share / size } else { 1 };
        Self { size, most_at_once }
    }

    pub fn of_batch(self, trajectories: usize) -> Parts {
        let count = trajectories.div_ceil(self.size).max(1);
        let threads = rayon::current_num_threads();
        let at_once = self.most_at_once.min(threads).min(count);
        Parts { size: self.size, count, at_once }
    }
}

fn together(model: &ModelSpec, parameters: u64) -> usize {
    match model {
        ModelSpec::Diffuser(_) | ModelSpec::Cdcnn(_) | ModelSpec::Flow(_)
            if parameters < LARGE_U_NET =>
        {
            TOGETHER_IN_U_NETS
        }
        ModelSpec::Diffuser(_) | ModelSpec::Cdcnn(_) | ModelSpec::Flow(_) => usize::MAX,
        _ => TOGETHER,
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;
    use spec::JobSpec;

    use super::{Parts, PartsSpec};
    use crate::device::DeviceKind;

    const FEW: u64 = 1000;

    fn parts(preset: &str, accumulation: u32, parameters: u64, threads: usize) -> Parts {
        parts_on(DeviceKind::Cpu, preset, accumulation, parameters, threads)
    }

    fn parts_on(
        kind: DeviceKind,
        preset: &str,
        accumulation: u32,
        parameters: u64,
        threads: usize,
    ) -> Parts {
        let job = json!({
            "kind": "train", "data": {"dataset": 1}, "model": {"preset": preset}, "steps": 1,
            "batch_size": 64,
        });
        let JobSpec::Train(spec) = spec::parse(job.to_string().as_bytes()).unwrap() else {
            panic!("not a training")
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| PartsSpec::new(&spec, accumulation, parameters, kind).of_batch(64))
    }

    #[test]
    fn parts_have_the_same_size_on_any_number_of_threads() {
        for (preset, size) in [("robomorph-tiny", 16), ("cdt-tiny", 16), ("diffuser-tiny", 32)] {
            for threads in [1, 2, 8] {
                let count = 64 / size;
                let expected = Parts { size, count, at_once: threads.min(count) };
                assert_eq!(parts(preset, 1, FEW, threads), expected);
            }
        }
    }

    #[test]
    fn parts_of_large_models_are_computed_one_after_the_other() {
        let expected = Parts { size: 16, count: 4, at_once: 1 };
        assert_eq!(parts("cdt-paper", 1, 40_000_000, 8), expected);
        let expected = Parts { size: 32, count: 2, at_once: 1 };
        assert_eq!(parts("cdcnn-paper", 1, 17_000_000, 8), expected);
        let expected = Parts { size: 64, count: 1, at_once: 1 };
        assert_eq!(parts("diffuser-paper", 1, 63_000_000, 8), expected);
    }

    #[test]
    fn no_more_trajectories_are_computed_at_once_than_accumulation_allows() {
        let of = |accumulation| parts("cdt-tiny", accumulation, FEW, 8);
        assert_eq!(of(2), Parts { size: 16, count: 4, at_once: 2 });
        assert_eq!(of(4), Parts { size: 16, count: 4, at_once: 1 });
        assert_eq!(of(16), Parts { size: 4, count: 16, at_once: 1 });
    }

    #[test]
    fn a_gpu_computes_whole_batches() {
        let of = |accumulation| parts_on(DeviceKind::Gpu, "cdt-tiny", accumulation, FEW, 8);
        assert_eq!(of(1), Parts { size: 64, count: 1, at_once: 1 });
        assert_eq!(of(4), Parts { size: 16, count: 4, at_once: 1 });
    }
}

//! How much memory a training needs, told before it begins.

mod tally;

use crate::{Doubt, ModelSpec, TrainSpec};
use tally::Tally;

const F32: u64 = 4;

/// Copies of the parameters while a step is taken: weights, gradients, both moments.
const COPIES: u64 = 4;
/// Copies in the making of a checkpoint: weights and both moments as they are, as lists of numbers
/// and as the bytes of files, and what the last step left behind.
const COPIES_OF_A_CHECKPOINT: u64 = 10;

/// Program, threads, and batches that are read ahead.
const BASE: u64 = 120 << 20;

/// What the allocator holds beside what is in use, of 10.
const HELD_BACK: u64 = 1;

/// An estimate of what a training holds in memory at its most.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TrainingMemory {
    pub parameters: u64,
    /// What follows from the parameters: weights, gradients, moments, averages.
    pub state_bytes: u64,
    /// What a step keeps of the trajectories that are computed at once.
    pub activation_bytes: u64,
    /// Resident in all, at the highest.
    pub peak_bytes: u64,
}

impl ModelSpec {
    /// How many numbers a model of this spec has to learn; `context` and `horizon` in samples.
    pub fn parameters(&self, context: u32, horizon: u32) -> u64 {
        Tally::of(self, context, horizon).parameters
    }
}

impl TrainSpec {
    /// Of a training on trajectories of `samples`, on the CPU.
    pub fn memory(&self, samples: u32) -> TrainingMemory {
        self.memory_in_parts(samples, self.gradient_accumulation)
    }

    fn memory_in_parts(&self, samples: u32, parts: u32) -> TrainingMemory {
        let tally = Tally::of(&self.model, self.context, samples.saturating_sub(self.context));
        let at_once = u64::from(self.batch_size.div_ceil(parts.max(1)));
        let average = u64::from(self.ema.is_some());
        // Gradients of the parts of a batch are added up.
        let sums = u64::from(parts > 1);
        let of_parameters = |copies: u64| copies * tally.parameters * F32;
        let state_bytes = of_parameters(COPIES + average + sums);
        let activation_bytes = at_once * tally.kept * F32;
        let used = (state_bytes + activation_bytes)
            .max(of_parameters(COPIES_OF_A_CHECKPOINT + 3 * average))
            + tally.scratch * F32;
        TrainingMemory {
            parameters: tally.parameters,
            state_bytes,
            activation_bytes,
            peak_bytes: BASE + used + used / 10 * HELD_BACK,
        }
    }

    /// Why a training on trajectories of `samples` may not fit into `available` bytes.
    pub fn memory_doubt(&self, samples: u32, available: u64) -> Option<Doubt> {
        let needed = self.memory(samples);
        if needed.peak_bytes <= available {
            return None;
        }
        let enough = (1..=self.batch_size)
            .filter(|parts| self.batch_size.is_multiple_of(*parts))
            .find(|&parts| self.memory_in_parts(samples, parts).peak_bytes <= available);
        let advice = match enough {
            Some(parts) => format!(
                "with \"gradient_accumulation\": {parts} about {} would do, for the same steps",
                gigabytes(self.memory_in_parts(samples, parts).peak_bytes)
            ),
            None => "no gradient_accumulation makes it fit; a smaller model does".to_owned(),
        };
        Some(Doubt {
            field: "batch_size".to_owned(),
            value: format!(
                "{} in {} at once",
                self.batch_size,
                self.batch_size.div_ceil(self.gradient_accumulation.max(1))
            ),
            reason: format!(
                "the training needs about {} of memory, {} of it for what its {} parameters bring \
                 along and {} for a step; the server's machine has {}, and if a worker has no more, \
                 the system may end it; {advice}",
                gigabytes(needed.peak_bytes),
                gigabytes(needed.state_bytes),
                needed.parameters,
                gigabytes(needed.activation_bytes),
                gigabytes(available),
            ),
        })
    }
}

#[expect(clippy::cast_precision_loss, reason = "two digits are shown")]
fn gigabytes(bytes: u64) -> String {
    format!("{:.2} GiB", bytes as f64 / f64::from(1 << 30))
}

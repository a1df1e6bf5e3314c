//! A chain computes the part that does not depend on the noisy horizon for several levels at once,
//! and once for all samples of a trajectory. Its answers equal those of whole passes, in any batch.

use burn::tensor::Tensor;
use kernels::Mask;

use super::{AHEAD, Cdt};
use crate::device::host_values;
use crate::layers::Dropout;
use crate::transformer::{Seen, patches};

/// Trajectories, each at one noise level, whose contexts are computed together: enough for
/// efficient matrix products, few enough to stay in the caches.
const AT_ONCE: usize = 8;

/// Answers of a CDT at one noise level after the other, about the same trajectories.
///
/// The encoder's output and the decoder's view of the context depend on the level, but not on the
/// noisy horizon: the encoder does not see it, and the decoder is causal. So both are computed for
/// several levels together, before the first of these levels. In the last block only the keys and
/// values of the context are computed, because later samples need nothing else. Rows of the same
/// trajectory follow each other and share one computation. The answers equal those of whole passes.
pub(crate) struct Chain<'a> {
    network: &'a Cdt,
    /// Clean y of the distinct trajectories, `[trajectory, context, joint]`.
    context: Tensor<3>,
    /// The known series of whole trajectories.
    known: Tensor<3>,
    /// Number of samples that are drawn of each trajectory.
    copies: Vec<usize>,
    /// The levels that follow.
    levels: std::vec::IntoIter<usize>,
    /// Keys and values that the horizon sees, for each of the next levels and in each decoder
    /// block.
    begun: std::vec::IntoIter<Vec<Seen>>,
}

impl<'a> Chain<'a> {
    pub fn new(network: &'a Cdt, context: Tensor<3>, known: Tensor<3>, levels: Vec<usize>) -> Self {
        let begun = Vec::new().into_iter();
        let copies = copies(&[&context, &known]);
        let (context, known) = (firsts(context, &copies), firsts(known, &copies));
        Self { network, context, known, copies, levels: levels.into_iter(), begun }
    }

    /// The answer at the next level to the noisy y of the horizon, `[batch, horizon, joint]`.
    ///
    /// # Panics
    /// When there is no level left.
    pub fn answer(&mut self, noisy: Tensor<3>) -> Tensor<3> {
        let seen = self.begun.next().unwrap_or_else(|| {
            self.begun = self.begin().into_iter();
            self.begun.next().expect("a level for every answer")
        });
        let network = self.network;
        let [_, context, _] = self.context.dims();
        let mut x = network.embedded(noisy, context);
        let drawn_once = self.copies.iter().all(|&count| count == 1);
        for (block, seen) in network.decoder_blocks.iter().zip(seen) {
            let seen = if drawn_once { seen } else { seen.copied(&self.copies) };
            x = block.forward_after(x, &seen, AHEAD);
        }
        network.answer(x)
    }

    /// Keys and values that the horizon sees, at each of the next levels in each decoder block.
    fn begin(&mut self) -> Vec<Vec<Seen>> {
        let network = self.network;
        let [batch, _, _] = self.context.dims();
        let levels: Vec<usize> = self.levels.by_ref().take((AT_ONCE / batch).max(1)).collect();
        let of_rows: Vec<usize> =
            levels.iter().flat_map(|&level| std::iter::repeat_n(level, batch)).collect();
        let repeated = |series: &Tensor<3>| series.clone().repeat(&[levels.len(), 1, 1]);

        let positions = network.condition_positions.val();
        let condition = network.condition(&of_rows, repeated(&self.known));
        let mut memory = condition + positions.unsqueeze();
        for block in &network.encoder_blocks {
            memory = block.forward(memory, Mask::None, &mut Dropout::off());
        }
        let mut x = repeated(&network.embedded(self.context.clone(), 0));
        let mut begun: Vec<Vec<Seen>> = levels.iter().map(|_| Vec::new()).collect();
        let last = network.decoder_blocks.len() - 1;
        for (index, block) in network.decoder_blocks.iter().enumerate() {
            let (query, seen) = block.seen(&x, memory.clone());
            if index < last {
                x = block.forward_seen(x, query, &seen, AHEAD);
            }
            for (begun, seen) in begun.iter_mut().zip(seen.split(batch)) {
                begun.push(seen);
            }
        }
        begun
    }
}

/// Lengths of the runs of consecutive rows that are equal in all series. Each series is `[row,
/// sample, channel]`.
fn copies(series: &[&Tensor<3>]) -> Vec<usize> {
    let [rows, _, _] = series[0].dims();
    // A device that cannot read values back counts every row as a trajectory of its own.
    let values: Result<Vec<_>, _> =
        series.iter().map(|tensor| host_values((*tensor).clone())).collect();
    let Ok(values) = values else { return vec![1; rows] };
    let is_repeated = |row: usize| {
        values.iter().all(|values| {
            let length = values.len() / rows;
            values[(row - 1) * length..row * length] == values[row * length..(row + 1) * length]
        })
    };
    let mut copies = Vec::new();
    for row in 0..rows {
        match copies.last_mut() {
            Some(count) if is_repeated(row) => *count += 1,
            _ => copies.push(1),
        }
    }
    copies
}

/// The first row of each run.
fn firsts(series: Tensor<3>, copies: &[usize]) -> Tensor<3> {
    let [rows, _, _] = series.dims();
    if copies.len() == rows {
        return series;
    }
    let mut next = 0;
    let firsts = copies.iter().map(|count| {
        let first = next;
        next += count;
        series.clone().narrow(0, first, 1)
    });
    Tensor::cat(firsts.collect(), 0)
}

impl Cdt {
    /// Tokens of y `[batch, sample, joint]` that begins with sample `first` of the trajectory.
    fn embedded(&self, y: Tensor<3>, first: usize) -> Tensor<3> {
        let y = patches(y, self.patch);
        let [_, tokens, _] = y.dims();
        let first = first / self.patch;
        let positions = self.positions.val().slice([first..first + tokens, 0..self.d_model]);
        self.input.forward(y) + positions.unsqueeze()
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::{Device, Tensor};
    use serde_json::json;

    use super::super::Cdt;
    use super::{Chain, copies};
    use crate::architecture::Extents;
    use crate::denoiser::Network;
    use crate::device::host_values;
    use crate::initialization::InitialWeights;

    const JOINTS: usize = 7;
    const SAMPLES: usize = 68;
    const CONTEXT: usize = 52;

    /// The cases have fewer levels than are computed together, as many, and more, for one
    /// trajectory and for several.
    #[test]
    fn a_chain_gives_the_answers_of_whole_passes() {
        for patch in [1, 4] {
            check_answers(patch);
        }
    }

    fn check_answers(patch: u32) {
        let sizes = json!({
            "d_model": 24, "heads": 3, "encoder_layers": 2, "decoder_layers": 3, "patch": patch,
        });
        let [context, samples] = [CONTEXT, SAMPLES].map(|samples| u32::try_from(samples).unwrap());
        let extents = Extents { context, horizon: samples - context, joints: JOINTS };
        let device = Device::flex();
        let mut weights = InitialWeights::new(3, &device);
        let spec = serde_json::from_value(sizes).unwrap();
        let network = Cdt::new(&spec, extents, &mut weights).unwrap();
        let mut random =
            |batch, samples| -> Tensor<3> { weights.normal([batch, samples, JOINTS], 1.0).val() };
        for (batch, count) in [(1, 1), (1, 3), (1, 8), (1, 11), (3, 5), (9, 2)] {
            let levels: Vec<usize> = (0..count).rev().collect();
            let (context, u) = (random(batch, CONTEXT), random(batch, SAMPLES));
            // The last trajectory has two samples.
            let twice = |series: &Tensor<3>| {
                Tensor::cat(vec![series.clone(), series.clone().narrow(0, batch - 1, 1)], 0)
            };
            let (context, u) = (twice(&context), twice(&u));
            let mut expected = vec![1; batch];
            expected[batch - 1] = 2;
            assert_eq!(copies(&[&context, &u]), expected);
            let batch = batch + 1;
            let mut chain = Chain::new(&network, context.clone(), u.clone(), levels.clone());
            for level in levels {
                let noisy = random(batch, SAMPLES - CONTEXT);
                let whole = Tensor::cat(vec![context.clone(), noisy.clone()], 1);
                let expected = network.forward(whole, &vec![level; batch], u.clone(), None);
                let expected = expected.slice([0..batch, CONTEXT..SAMPLES, 0..JOINTS]);
                let (found, expected) = (chain.answer(noisy), expected);
                let found = host_values(found).unwrap();
                for (found, expected) in found.iter().zip(host_values(expected).unwrap()) {
                    let case = (patch, batch, count, level);
                    assert!((found - expected).abs() < 2e-6, "{case:?}: {found} for {expected}");
                }
            }
        }
    }
}

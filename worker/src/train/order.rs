//! The order of training trajectories. It depends only on the seed and the step.
//!
//! Reading random rows from Parquet is slow, and reading row groups is fast. So an epoch shuffles
//! blocks (row groups), takes a few at a time into a window, and shuffles within the window.

use std::ops::Range;

use random::{ChaCha8Rng, shuffle};

/// Number of blocks that are shuffled together.
const BLOCKS_PER_WINDOW: usize = 4;

/// Consecutive trajectories of one shard that are read together, as indices in the dataset.
type Block = Range<u64>;

/// Assigns trajectories to batches.
#[derive(Clone, Debug)]
pub(crate) struct Order {
    blocks: Vec<Block>,
    batch_size: usize,
    seed: u64,
}

/// One epoch, window after window.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Epoch {
    pub windows: Vec<Window>,
}

/// Trajectories in the order of training, and the blocks that hold them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Window {
    pub blocks: Vec<Block>,
    pub trajectories: Vec<u64>,
}

impl Order {
    /// An order over `shards`, up to trajectory `end`. Each shard is given by its range of
    /// trajectories.
    pub fn new(shards: &[Range<u64>], end: u64, block: u64, batch_size: usize, seed: u64) -> Self {
        let blocks = shards.iter().flat_map(|shard| {
            let (start, end) = (shard.start, shard.end.min(end));
            (0..)
                .map(move |k| start + k * block)
                .take_while(move |&first| first < end)
                .map(move |first| first..(first + block).min(end))
        });
        Self { blocks: blocks.collect(), batch_size, seed }
    }

    /// Number of whole batches in an epoch. Remaining trajectories are left out until the next
    /// shuffle.
    pub fn batches_per_epoch(&self) -> u64 {
        let trajectories: u64 = self.blocks.iter().map(|block| block.end - block.start).sum();
        trajectories / self.batch_size as u64
    }

    /// The epoch of optimizer step `step` (from 0), and the step's index in it.
    pub fn place(&self, step: u64) -> (u64, u64) {
        let batches = self.batches_per_epoch().max(1);
        (step / batches, step % batches)
    }

    pub fn batch_size(&self) -> usize {
        self.batch_size
    }

    pub fn epoch(&self, epoch: u64) -> Epoch {
        let mut generator = self.generator(epoch);
        let mut blocks = self.blocks.clone();
        shuffle(&mut blocks, &mut generator);
        let windows = blocks.chunks(BLOCKS_PER_WINDOW).map(|blocks| {
            let mut trajectories: Vec<u64> = blocks.iter().flat_map(Range::clone).collect();
            shuffle(&mut trajectories, &mut generator);
            Window { blocks: blocks.to_vec(), trajectories }
        });
        Epoch { windows: windows.collect() }
    }

    fn generator(&self, epoch: u64) -> ChaCha8Rng {
        let purpose = [*b"batch or", *b"der\0\0\0\0\0"].map(u64::from_le_bytes);
        random::keyed([self.seed, epoch, purpose[0], purpose[1]])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn order() -> Order {
        Order::new(&[0..1000, 1000..2000, 2000..2400], 2300, 250, 64, 7)
    }

    fn trajectories(epoch: &Epoch) -> Vec<u64> {
        epoch.windows.iter().flat_map(|window| window.trajectories.clone()).collect()
    }

    #[test]
    fn an_epoch_holds_every_training_trajectory_once() {
        let mut seen = trajectories(&order().epoch(3));
        seen.sort_unstable();
        assert_eq!(seen, (0..2300).collect::<Vec<_>>());
    }

    #[test]
    fn a_window_holds_just_the_trajectories_of_its_blocks() {
        for window in order().epoch(0).windows {
            let within = |t: &u64| window.blocks.iter().any(|block| block.contains(t));
            assert!(window.trajectories.iter().all(within));
        }
    }

    #[test]
    fn blocks_do_not_cross_shards() {
        let order = Order::new(&[0..300, 300..600], 600, 250, 10, 0);
        assert_eq!(order.blocks, [0..250, 250..300, 300..550, 550..600]);
    }

    #[test]
    fn epochs_and_seeds_differ_and_repeat() {
        let again = order();
        assert_eq!(order().epoch(1), again.epoch(1));
        assert_ne!(trajectories(&order().epoch(1)), trajectories(&order().epoch(2)));
        let other = Order { seed: 8, ..order() };
        assert_ne!(trajectories(&order().epoch(1)), trajectories(&other.epoch(1)));
    }

    #[test]
    fn a_step_falls_into_its_epoch() {
        let order = order();
        assert_eq!(order.batches_per_epoch(), 35);
        assert_eq!([order.place(0), order.place(34), order.place(35)], [(0, 0), (0, 34), (1, 0)]);
    }
}

//! Batches, which are read or simulated ahead of the training.

use std::collections::HashMap;
use std::ops::{ControlFlow, Range};
use std::sync::mpsc::{Receiver, SyncSender};

use dynamics::Trajectories;
use series::Series;

use super::order::Order;
use crate::dataset::{Block, DatasetReader};
use crate::error::TaskError;
use crate::stream::Stream;

/// Smallest number of trajectories of a stream that are simulated at once. It keeps all lanes busy
/// while the last robots are drawn again.
const SIMULATED_AT_ONCE: usize = 256;

/// A batch, with the indices of the trajectories of each source in order.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct TrainingBatch {
    pub series: Series,
    pub trajectories: Vec<Vec<u64>>,
}

/// The channel for batches.
pub(super) type Send = SyncSender<Result<TrainingBatch, TaskError>>;

/// Sends batches with the trajectories of a batch of each source, until the receiver or a source is
/// gone.
pub(super) fn join(sources: &[Receiver<Result<TrainingBatch, TaskError>>], send: &Send) {
    loop {
        let mut joined: Option<TrainingBatch> = None;
        for source in sources {
            let part = match source.recv() {
                Ok(Ok(part)) => part,
                // If the receiver is gone, it has its own reason.
                Ok(Err(error)) => return drop(send.send(Err(error))),
                Err(_) => return,
            };
            match &mut joined {
                Some(joined) => {
                    joined.series.append(&part.series);
                    joined.trajectories.extend(part.trajectories);
                }
                None => joined = Some(part),
            }
        }
        let Some(joined) = joined else { return };
        if send.send(Ok(joined)).is_err() {
            return;
        }
    }
}

/// Sends the batches of optimizer steps `first` to `end` (excluded) of a stream, until the receiver
/// is gone or `stopped`. Step `s` has the trajectories `s · size` to `(s + 1) · size`.
///
/// It simulates on one thread and leaves the others to the training.
pub(super) fn simulate_ahead(
    stream: &Stream,
    size: usize,
    first: u64,
    end: u64,
    stopped: &(dyn Fn() -> bool + Sync),
    send: &Send,
) {
    if let Err(error) = send_stream(stream, size, first, end, stopped, send) {
        // If the receiver is gone, it has its own reason.
        let _ = send.send(Err(error));
    }
}

fn send_stream(
    stream: &Stream,
    size: usize,
    first: u64,
    end: u64,
    stopped: &(dyn Fn() -> bool + Sync),
    send: &Send,
) -> Result<(), TaskError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let at_once = SIMULATED_AT_ONCE.div_ceil(size) as u64;
    let mut simulated = Trajectories::default();
    let mut step = first;
    while step < end {
        let last = (step + at_once).min(end);
        let range = step * size as u64..last * size as u64;
        pool.install(|| stream.simulate(range, stopped, &mut simulated))?;
        for (step, first) in (step..last).zip((0..).step_by(size)) {
            let series = simulated.series.copy(first..first + size);
            let trajectories = vec![(step * size as u64..(step + 1) * size as u64).collect()];
            if send.send(Ok(TrainingBatch { series, trajectories })).is_err() {
                return Ok(());
            }
        }
        step = last;
    }
    Ok(())
}

/// Sends the batches of optimizer steps `first` to `end` (excluded), until the receiver is gone.
pub(super) fn read_ahead(data: &DatasetReader, order: &Order, first: u64, end: u64, send: &Send) {
    let mut step = first;
    while step < end {
        let (epoch, skipped) = order.place(step);
        let batches = (order.batches_per_epoch() - skipped).min(end - step);
        match send_epoch(data, order, epoch, skipped, batches, send) {
            Ok(ControlFlow::Continue(())) => step += batches,
            Ok(ControlFlow::Break(())) => return,
            Err(error) => {
                // If the receiver is gone, it has its own reason.
                let _ = send.send(Err(error));
                return;
            }
        }
    }
}

/// Sends `count` batches of an epoch, beginning with batch `skipped`. Breaks when the receiver is
/// gone.
fn send_epoch(
    data: &DatasetReader,
    order: &Order,
    epoch: u64,
    skipped: u64,
    count: u64,
    send: &Send,
) -> Result<ControlFlow<()>, TaskError> {
    let size = order.batch_size();
    let mut to_skip = usize::try_from(skipped).unwrap_or(usize::MAX).saturating_mul(size);
    let mut left = count;
    let empty = || data.empty(size);
    let mut series = empty()?;
    let mut trajectories = Vec::with_capacity(size);
    let mut windows = order.epoch(epoch).windows.into_iter().peekable();
    while let Some(window) = windows.next() {
        if to_skip >= window.trajectories.len() {
            to_skip -= window.trajectories.len();
            continue;
        }
        if let Some(next) = windows.peek() {
            data.fetch_ahead(&next.blocks);
        }
        let blocks = read_blocks(data, &window.blocks)?;
        let columns = blocks.iter().map(Block::columns).collect::<Result<Vec<_>, _>>()?;
        let places = places(&blocks);
        for index in &window.trajectories[std::mem::take(&mut to_skip)..] {
            let BlockPosition { block, robot } = places[index];
            series.gather(&columns[block], robot..robot + 1);
            trajectories.push(*index);
            if series.robots() < size {
                continue;
            }
            let series = std::mem::replace(&mut series, empty()?);
            let trajectories = vec![std::mem::take(&mut trajectories)];
            if send.send(Ok(TrainingBatch { series, trajectories })).is_err() {
                return Ok(ControlFlow::Break(()));
            }
            left -= 1;
            if left == 0 {
                return Ok(ControlFlow::Continue(()));
            }
        }
    }
    Ok(ControlFlow::Continue(()))
}

/// The position of a trajectory in the blocks of a window.
#[derive(Clone, Copy)]
struct BlockPosition {
    block: usize,
    robot: usize,
}

fn read_blocks(data: &DatasetReader, ranges: &[Range<u64>]) -> Result<Vec<Block>, TaskError> {
    let mut blocks = Vec::with_capacity(ranges.len());
    for range in ranges {
        blocks.extend(data.blocks(range.clone())?);
    }
    Ok(blocks)
}

/// The positions of trajectories, by index in the dataset.
fn places(blocks: &[Block]) -> HashMap<u64, BlockPosition> {
    let of_block = |(block, held): (usize, &Block)| {
        let robots = held.trajectories.clone().enumerate();
        robots.map(move |(robot, index)| (index, BlockPosition { block, robot }))
    };
    blocks.iter().enumerate().flat_map(of_block).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::sync_channel;
    use std::thread;

    use serde_json::json;
    use spec::{JobSpec, SimulateSpec};

    use super::*;

    fn spec() -> SimulateSpec {
        let spec = json!({"preset": "D2-mixed", "trajectories": 1, "samples": 30});
        match spec::parse(spec.to_string().as_bytes()).unwrap() {
            JobSpec::Simulate(spec) => spec,
            other => panic!("{other:?}"),
        }
    }

    fn batches(size: usize, first: u64, end: u64) -> Vec<TrainingBatch> {
        let stream = Stream::new(&spec());
        let (send, receive) = sync_channel(1);
        thread::scope(|scope| {
            scope.spawn(|| simulate_ahead(&stream, size, first, end, &|| false, &{ send }));
            receive.into_iter().map(Result::unwrap).collect()
        })
    }

    #[test]
    fn each_step_on_a_stream_has_its_own_trajectories_wherever_it_resumes() {
        let whole = batches(100, 0, 7);
        assert_eq!(whole.len(), 7);
        let simulated =
            dynamics::simulate(&spec(), 0..700, &|_| ControlFlow::Continue(())).unwrap();
        for (step, TrainingBatch { series, trajectories }) in whole.iter().enumerate() {
            let values = series.shape().values().unwrap();
            assert_eq!((series.robots(), series.samples()), (100, 30));
            assert_eq!(series.u(), &simulated.series.u()[step * values..][..values], "step {step}");
            assert_eq!(series.y(), &simulated.series.y()[step * values..][..values], "step {step}");
            let first = 100 * step as u64;
            assert_eq!(trajectories[..], [(first..first + 100).collect::<Vec<_>>()]);
        }
        for (resumed, batch) in batches(100, 4, 7).iter().zip(&whole[4..]) {
            assert_eq!(resumed, batch);
        }
    }

    #[test]
    fn a_batch_of_two_sources_has_the_trajectories_of_each_in_order() {
        let stream = Stream::new(&spec());
        let other = Stream::new(&SimulateSpec { seed: 5, ..spec() });
        let (send, receive) = sync_channel(1);
        let joined: Vec<TrainingBatch> = thread::scope(|scope| {
            let sources = [(&stream, 3), (&other, 2)].map(|(stream, size)| {
                let (send, receive) = sync_channel(1);
                scope.spawn(move || simulate_ahead(stream, size, 1, 4, &|| false, &send));
                receive
            });
            scope.spawn(move || join(&sources, &{ send }));
            receive.into_iter().map(Result::unwrap).collect()
        });
        assert_eq!(joined.len(), 3);
        let values = joined[0].series.shape().values_per_robot();
        let alone = |seed, range| {
            let spec = SimulateSpec { seed, ..spec() };
            dynamics::simulate(&spec, range, &|_| ControlFlow::Continue(())).unwrap().series
        };
        for (step, batch) in (1..).zip(&joined) {
            let [first, second] = [3 * step..3 * step + 3, 2 * step..2 * step + 2];
            assert_eq!(batch.trajectories[0], first.clone().collect::<Vec<_>>());
            assert_eq!(batch.trajectories[1], second.clone().collect::<Vec<_>>());
            assert_eq!(batch.series.robots(), 5);
            assert_eq!(batch.series.y()[..3 * values], *alone(spec().seed, first).y());
            assert_eq!(batch.series.u()[3 * values..], *alone(5, second).u());
        }
    }

    #[test]
    fn batches_of_a_noisy_stream_hold_what_is_measured_and_the_truth() {
        let mut noisy = spec();
        noisy.observations.position_noise_rad = 1e-3;
        let stream = Stream::new(&noisy);
        let (send, receive) = sync_channel(1);
        let found: Vec<TrainingBatch> = thread::scope(|scope| {
            scope.spawn(|| simulate_ahead(&stream, 20, 0, 3, &|| false, &{ send }));
            receive.into_iter().map(Result::unwrap).collect()
        });
        for (batch, clean) in found.iter().zip(batches(20, 0, 3)) {
            assert_eq!(batch.series.true_y(), clean.series.y());
            assert_ne!(batch.series.y(), clean.series.y());
            assert_eq!(batch.series.noise().position_rad, 1e-3);
        }
    }

    #[test]
    fn a_stream_ends_when_it_is_told_to() {
        let stream = Stream::new(&spec());
        let (send, receive) = sync_channel(4);
        simulate_ahead(&stream, 64, 0, u64::MAX / 64, &|| true, &send);
        assert!(matches!(receive.recv().unwrap(), Err(TaskError::Stopped)));
    }

    #[test]
    fn a_stream_ends_when_nobody_listens() {
        let stream = Stream::new(&spec());
        let (send, receive) = sync_channel(1);
        drop(receive);
        simulate_ahead(&stream, 64, 0, u64::MAX / 64, &|| false, &send);
    }
}

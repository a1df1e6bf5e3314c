//! The course of a training: which trajectories it sees, and when.

use std::ops::Range;

use models::{Statistics, StatisticsAccumulator};
use series::Series;
use spec::{DataSpec, TrainSpec};

use super::batches::{self, Send};
use super::order::Order;
use crate::attempt::Attempt;
use crate::dataset::DatasetReader;
use crate::error::TaskError;
use crate::stream::Stream;
use crate::trajectories::TrajectorySource;

/// Index of the first trajectory of a stream that is used for validation. No training reaches it:
/// the most there can be, 10^7 steps of 4096 trajectories, end before 2^36.
const STREAM_VALIDATION: u64 = 1 << 40;

/// Number of trajectories of a stream for fixed statistics. Their error is below a hundredth of a
/// standard deviation.
const STREAM_STATISTICS: u64 = 4096;

/// The data of a training, and their order.
pub(super) struct Course {
    source: Source,
    batch_size: u32,
    /// Trajectories for fixed statistics: all training trajectories of a dataset, and the first
    /// ones of a stream.
    statistics: Range<u64>,
    validation: Range<u64>,
}

#[expect(clippy::large_enum_variant, reason = "one or two exist at a time")]
enum Source {
    /// Trains on a dataset, epoch after epoch.
    Dataset { data: DatasetReader, order: Order },
    /// Trains on each robot of a stream once.
    Stream(Stream),
}

impl Course {
    pub fn open(attempt: &Attempt, spec: &TrainSpec) -> Result<Self, TaskError> {
        let batch_size = spec.batch_size;
        let used = u64::from(spec.validation_trajectories);
        match TrajectorySource::open(attempt, &spec.data)? {
            TrajectorySource::Dataset(data) => {
                // The size of imported data was not known when the training was submitted.
                spec.check_trajectories(data.count())?;
                let trained = spec.training_trajectories(data.count());
                let kept = spec.validation_part(data.count()).min(used);
                let (shards, block) = (data.shards(), data.block());
                let order = Order::new(&shards, trained, block, batch_size as usize, spec.seed);
                Ok(Self {
                    source: Source::Dataset { data, order },
                    batch_size,
                    statistics: 0..trained,
                    validation: trained..trained + kept,
                })
            }
            TrajectorySource::Stream(stream) => {
                let kept = if spec.validation_fraction > 0.0 { used } else { 0 };
                Ok(Self {
                    source: Source::Stream(stream),
                    batch_size,
                    statistics: 0..STREAM_STATISTICS,
                    validation: STREAM_VALIDATION..STREAM_VALIDATION + kept,
                })
            }
        }
    }

    pub fn data(&self) -> &DataSpec {
        match &self.source {
            Source::Dataset { data, .. } => &data.spec,
            Source::Stream(stream) => &stream.data,
        }
    }

    /// Sends the batches of optimizer steps `first` to `end` (excluded), until the receiver is
    /// gone. The batch of a step depends only on the step.
    pub fn send_batches(&self, attempt: &Attempt, first: u64, end: u64, send: &Send) {
        match &self.source {
            Source::Dataset { data, order } => batches::read_ahead(data, order, first, end, send),
            Source::Stream(stream) => {
                let size = self.batch_size as usize;
                let stopped = || attempt.stop.get().is_some();
                batches::simulate_ahead(stream, size, first, end, &stopped, send);
            }
        }
    }

    /// Statistics of the trajectories. They are added in order, so the result is the same every
    /// time.
    pub fn statistics(&self, attempt: &Attempt) -> Result<Statistics, TaskError> {
        attempt.progress.say("statistics of the dataset".to_owned());
        let mut accumulator = StatisticsAccumulator::new(self.data().joints());
        let block = u64::from(store::trajectories_per_row_group(self.data().samples()));
        for part in parts(&self.statistics, block) {
            attempt.check_stop()?;
            accumulator.add(&self.read(attempt, part)?.view());
        }
        Ok(accumulator.finish())
    }

    /// The validation trajectories, in batches.
    pub fn validation(&self, attempt: &Attempt) -> Result<Vec<Series>, TaskError> {
        parts(&self.validation, u64::from(self.batch_size))
            .map(|part| {
                attempt.check_stop()?;
                self.read(attempt, part)
            })
            .collect()
    }

    fn read(&self, attempt: &Attempt, range: Range<u64>) -> Result<Series, TaskError> {
        match &self.source {
            Source::Dataset { data, .. } => data.read(range),
            Source::Stream(stream) => stream.read(attempt, range),
        }
    }
}

/// `range` in parts of `size`. The last part may be shorter.
fn parts(range: &Range<u64>, size: u64) -> impl Iterator<Item = Range<u64>> + use<> {
    let Range { start, end } = *range;
    (0..)
        .map(move |k| start + k * size)
        .take_while(move |first| *first < end)
        .map(move |first| first..(first + size).min(end))
}

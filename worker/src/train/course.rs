//! The course of a training: which trajectories it sees, and when.

use std::ops::Range;
use std::sync::mpsc::sync_channel;
use std::thread;

use models::{Statistics, StatisticsAccumulator};
use series::Series;
use spec::{DataSource, DataSpec, TrainSpec};

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

/// Seeds of specs lie below this. The order of a training's second source has the seed after the
/// next multiple of it, and so on, so that sources of the same size have different orders.
const SEEDS: u64 = 1 << 53;

/// The data of a training, and their order.
pub(super) struct Course {
    parts: Vec<Part>,
}

/// A source of a training's data.
struct Part {
    source: Source,
    /// Trajectories that it gives to every batch.
    share: u32,
    /// Trajectories for fixed statistics: all training trajectories of a dataset, and the first
    /// ones of a stream.
    statistics: Range<u64>,
    validation: Range<u64>,
}

#[expect(clippy::large_enum_variant, reason = "a few exist at a time")]
enum Source {
    /// Trains on a dataset, epoch after epoch.
    Dataset { data: DatasetReader, order: Order },
    /// Trains on each robot of a stream once.
    Stream(Stream),
}

impl Course {
    pub fn open(attempt: &Attempt, spec: &TrainSpec) -> Result<Self, TaskError> {
        let open = |source: &DataSource| TrajectorySource::open(attempt, source, spec.given);
        let sources: Vec<TrajectorySource> =
            spec.data.each().iter().map(open).collect::<Result<_, _>>()?;
        // The size of imported data was not known when the training was submitted.
        let counts: Vec<Option<u64>> = sources.iter().map(TrajectorySource::count).collect();
        spec.check_trajectories(&counts)?;
        if let Some(doubt) = spec.validation_doubt(&counts) {
            tracing::warn!("{doubt}");
        }
        let seeds = (0..).map(|place| spec.seed + place * SEEDS);
        let parts = sources.into_iter().zip(spec.shares()).zip(seeds);
        Ok(Self {
            parts: parts
                .map(|((source, share), seed)| Part::new(spec, source, share, seed))
                .collect(),
        })
    }

    /// The first data. Others have the same shape and rate.
    pub fn data(&self) -> &DataSpec {
        self.parts[0].source.data()
    }

    /// Sends the batches of optimizer steps `first` to `end` (excluded), until the receiver is
    /// gone. The batch of a step depends only on the step.
    pub fn send_batches(&self, attempt: &Attempt, first: u64, end: u64, send: &Send) {
        if let [part] = &self.parts[..] {
            return part.send_batches(attempt, first, end, send);
        }
        thread::scope(|scope| {
            let receivers: Vec<_> = self
                .parts
                .iter()
                .map(|part| {
                    let (send, receive) = sync_channel(1);
                    scope.spawn(move || part.send_batches(attempt, first, end, &send));
                    receive
                })
                .collect();
            batches::join(&receivers, send);
        });
    }

    /// Statistics of the trajectories. They are added in order, so the result is the same every
    /// time.
    pub fn statistics(&self, attempt: &Attempt) -> Result<Statistics, TaskError> {
        attempt.progress.say("statistics of the dataset".to_owned());
        let mut accumulator = StatisticsAccumulator::new(self.data().joints());
        let block = u64::from(store::trajectories_per_row_group(self.data().samples()));
        for part in &self.parts {
            for range in ranges(&part.statistics, block) {
                attempt.check_stop()?;
                accumulator.add(&part.read(attempt, range)?.view());
            }
        }
        Ok(accumulator.finish())
    }

    /// The validation trajectories in batches, which have the shares of those of the training.
    pub fn validation(&self, attempt: &Attempt) -> Result<Vec<Series>, TaskError> {
        let mut batches: Vec<Series> = Vec::new();
        for part in &self.parts {
            for (place, range) in ranges(&part.validation, u64::from(part.share)).enumerate() {
                attempt.check_stop()?;
                let series = part.read(attempt, range)?;
                match batches.get_mut(place) {
                    Some(batch) => batch.append(&series),
                    None => batches.push(series),
                }
            }
        }
        Ok(batches)
    }
}

impl Part {
    fn new(spec: &TrainSpec, source: TrajectorySource, share: u32, seed: u64) -> Self {
        let used = u64::from(spec.validation_trajectories) * u64::from(share);
        let used = used.div_ceil(u64::from(spec.batch_size));
        match source {
            TrajectorySource::Dataset(data) => {
                let trained = spec.training_trajectories(data.count());
                let kept = spec.validation_part(data.count()).min(used);
                let (shards, block) = (data.shards(), data.block());
                let order = Order::new(&shards, trained, block, share as usize, seed);
                Self {
                    source: Source::Dataset { data, order },
                    share,
                    statistics: 0..trained,
                    validation: trained..trained + kept,
                }
            }
            TrajectorySource::Stream(stream) => {
                let kept = if spec.validation_fraction > 0.0 { used } else { 0 };
                Self {
                    source: Source::Stream(stream),
                    share,
                    statistics: 0..STREAM_STATISTICS,
                    validation: STREAM_VALIDATION..STREAM_VALIDATION + kept,
                }
            }
        }
    }

    fn send_batches(&self, attempt: &Attempt, first: u64, end: u64, send: &Send) {
        match &self.source {
            Source::Dataset { data, order } => batches::read_ahead(data, order, first, end, send),
            Source::Stream(stream) => {
                let size = self.share as usize;
                let stopped = || attempt.stop.get().is_some();
                batches::simulate_ahead(stream, size, first, end, &stopped, send);
            }
        }
    }

    fn read(&self, attempt: &Attempt, range: Range<u64>) -> Result<Series, TaskError> {
        match &self.source {
            Source::Dataset { data, .. } => data.read(range),
            Source::Stream(stream) => stream.read(attempt, range),
        }
    }
}

impl Source {
    fn data(&self) -> &DataSpec {
        match self {
            Self::Dataset { data, .. } => &data.spec,
            Self::Stream(stream) => &stream.data,
        }
    }
}

/// `range` in ranges of `size`. The last one may be shorter.
fn ranges(range: &Range<u64>, size: u64) -> impl Iterator<Item = Range<u64>> + use<> {
    let Range { start, end } = *range;
    (0..)
        .map(move |k| start + k * size)
        .take_while(move |first| *first < end)
        .map(move |first| first..(first + size).min(end))
}

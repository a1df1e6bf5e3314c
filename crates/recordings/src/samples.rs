//! Turns rows into samples: in SI units, with each value checked.

use spec::{AngleUnit, ImportRanges, ImportSpec, JointDescription, Range};

use crate::error::{Place, RowError};
use crate::rows::{MAX_CHANNELS, Rows, TimeColumn};
use crate::turns::Turns;

/// Torques, positions and perhaps velocities at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sample {
    /// Seconds from an arbitrary origin; see [`Sampling::file_time_s`].
    pub time_s: f64,
    /// Index of the file's row at or before it, from 0.
    pub row: u64,
    /// The place of the same row, for errors.
    pub place: Place,
    /// Values in N·m, rad and rad/s. Those beyond the file's channels are 0.
    pub values: [f64; MAX_CHANNELS],
}

/// Options for turning rows of a file into samples.
pub(crate) struct Sampling {
    channels: Vec<Channel>,
    time: Option<Time>,
    rate_hz: f64,
}

/// Options for turning a column into a channel.
struct Channel {
    column: String,
    /// Factor from the file's unit to `unit`.
    factor: f64,
    unit: &'static str,
    range: Range,
    /// The source of that range.
    range_source: String,
    /// Whether the file may actually be in degrees.
    maybe_degrees: bool,
    /// The turns of an angle that is made continuous.
    turns: Option<Turns>,
}

struct Time {
    column: String,
    /// The file's unit of time in seconds: the one of the spec, unless the column has its own.
    unit_s: f64,
    /// The origin from which integers are counted, so that times since 1970 keep all their digits.
    origin: Option<i64>,
}

impl Sampling {
    pub fn new(spec: &ImportSpec) -> Self {
        let radians = spec.units.angle == AngleUnit::Rad;
        let angle = if radians { 1.0 } else { 1f64.to_radians() };
        let columns = &spec.columns;
        let [u_limits, q_limits, qd_limits] = limits(spec);
        let turns = spec.unwrap.then(Turns::default);
        let groups = [
            (Some(&columns.u), 1.0, "N·m", u_limits, false, None),
            (Some(&columns.q), angle, "rad", q_limits, radians, turns),
            (columns.qd.as_ref(), angle, "rad/s", qd_limits, radians, None),
        ];
        let mut channels = Vec::new();
        for (names, factor, unit, limits, maybe_degrees, turns) in groups {
            let gains = columns.gains.as_deref().filter(|_| unit == "N·m").unwrap_or_default();
            let factors = gains.iter().copied().chain(std::iter::repeat(factor));
            let limited = names.into_iter().flatten().zip(limits);
            for ((column, (range, range_source)), factor) in limited.zip(factors) {
                let column = column.clone();
                channels.push(Channel {
                    column,
                    factor,
                    unit,
                    range,
                    range_source,
                    maybe_degrees,
                    turns,
                });
            }
        }
        let unit_s = spec.units.time.seconds();
        let time = columns.time.clone().map(|column| Time { column, unit_s, origin: None });
        Self { channels, time, rate_hz: spec.rate_hz }
    }

    pub fn channel_count(&self) -> usize {
        self.channels.len()
    }

    /// The sample of row `index` of `rows`. `since_start` rows of its recording came before it.
    ///
    /// # Errors
    /// When a value is not finite or outside its range.
    pub fn sample(
        &mut self,
        rows: &Rows,
        index: usize,
        since_start: u64,
    ) -> Result<Sample, RowError> {
        let place = rows.place(index);
        let mut values = [0.0; MAX_CHANNELS];
        let channels = self.channels.iter_mut().zip(&rows.channels);
        for (value, (channel, column)) in values.iter_mut().zip(channels) {
            if since_start == 0 {
                channel.turns = channel.turns.map(|_| Turns::default());
            }
            *value = channel.convert(column[index], place)?;
        }
        let time_s = match (&mut self.time, &rows.time) {
            (Some(time), Some(times)) => time.seconds(times, index, place)?,
            #[expect(clippy::cast_precision_loss, reason = "far fewer than 2^53 rows")]
            _ => since_start as f64 / self.rate_hz,
        };
        Ok(Sample { time_s, row: rows.first + index as u64, place, values })
    }

    /// The time of a sample in the file's own count, s.
    pub fn file_time_s(&self, sample: &Sample) -> f64 {
        sample.time_s + self.time.as_ref().map_or(0.0, Time::origin_s)
    }
}

/// The ranges of each joint's torques, positions and velocities, with their source: `ranges`, or
/// the description of the robot.
fn limits(spec: &ImportSpec) -> [Vec<(Range, String)>; 3] {
    let robot = spec.robot();
    let joints = &robot.description().joints;
    let limits = |range: Option<Range>, range_field: &str, limit_field: &str, limit: Limit| {
        let of_joint = |(number, joint)| match range {
            Some(range) => (range, range_field.to_owned()),
            None => {
                let source = format!(
                    "{limit_field} of joint {number} in robot.model; {range_field} replaces it"
                );
                (limit(joint), source)
            }
        };
        (1..).zip(joints).map(of_joint).collect()
    };
    let both_ways = |limit: f64| Range::new(-limit, limit);
    let ImportRanges { u_nm, q_rad, qd_rad_s } = spec.ranges;
    [
        limits(u_nm, "ranges.u_nm", "torque_nm", &|joint| both_ways(joint.torque_nm)),
        limits(q_rad, "ranges.q_rad", "position_rad", &|joint| joint.position_rad),
        limits(qd_rad_s, "ranges.qd_rad_s", "velocity_rad_s", &|joint| {
            both_ways(joint.velocity_rad_s)
        }),
    ]
}

/// The largest speed of a joint, with its source.
#[derive(Clone, Debug)]
pub(crate) struct VelocityLimit {
    pub rad_s: f64,
    pub source: String,
}

/// The limit of each joint: `ranges.qd_rad_s`, or the one in the description of the robot.
pub(crate) fn velocity_limits(spec: &ImportSpec) -> impl Iterator<Item = VelocityLimit> {
    let [_, _, velocities] = limits(spec);
    velocities.into_iter().map(|(range, source)| VelocityLimit {
        rad_s: range.min.abs().max(range.max.abs()),
        source,
    })
}

/// Reads a limit of a joint.
type Limit<'a> = &'a dyn Fn(&JointDescription) -> Range;

impl Channel {
    fn convert(&mut self, written: f64, place: Place) -> Result<f64, RowError> {
        let mut value = written * self.factor;
        if let Some(turns) = self.turns.as_mut().filter(|_| value.is_finite()) {
            value = turns.unwrap(value, self.range);
        }
        if self.range.contains(value) {
            return Ok(value);
        }
        let Range { min, max } = self.range;
        let unit = self.unit;
        let mut allowed = format!("{min} to {max} {unit} ({})", self.range_source);
        if !value.is_finite() {
            allowed = format!("a finite number, {allowed}");
        } else if self.maybe_degrees && self.range.contains(value.to_radians()) {
            allowed.push_str("; if the file is in degrees, say so in units.angle");
        }
        let found = format!("{value} {unit}");
        Err(RowError::value(place, &self.column, found, allowed))
    }
}

impl Time {
    #[expect(clippy::cast_precision_loss, reason = "a difference, not the count since 1970")]
    fn seconds(&mut self, times: &TimeColumn, index: usize, place: Place) -> Result<f64, RowError> {
        let (whole, part) = match times {
            TimeColumn::Integer(times) => (times[index], 0.0),
            TimeColumn::Decimal(times) => (0, times[index]),
            TimeColumn::Dated(times, unit) => {
                self.unit_s = unit.seconds();
                (times[index], 0.0)
            }
        };
        if !part.is_finite() {
            return Err(RowError::value(place, &self.column, part.to_string(), "a finite number"));
        }
        let origin = *self.origin.get_or_insert(whole);
        let since_origin = (i128::from(whole) - i128::from(origin)) as f64;
        Ok((since_origin + part) * self.unit_s)
    }

    /// The offset to the file's own count of time, s.
    #[expect(clippy::cast_precision_loss, reason = "a date for people to look at")]
    fn origin_s(&self) -> f64 {
        self.origin.unwrap_or_default() as f64 * self.unit_s
    }
}

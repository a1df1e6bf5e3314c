//! Finds joints whose position stays the same to the last bit although they move: a sensor that
//! froze, or a column of stale values.
//!
//! If the file has velocities, they contradict such a position, and it is refused. Otherwise the
//! joint may be held by a brake or a controller, so it is a warning.

use spec::ImportSpec;

use crate::error::{Place, RowError};
use crate::recording::rounded;
use crate::samples::Sample;

/// The smallest way that velocities claim while a position stays, rad, and the mean speed, rad/s.
/// Coarse encoders turn less between two values, and a velocity may be off by less.
const CLAIMED_RAD: f64 = 0.1;
const CLAIMED_RAD_S: f64 = 0.1;

/// The shortest time for a refusal, s, and for a warning. `max_gap_s` replaces the first if it is
/// longer: positions may be measured that rarely.
const REFUSED_S: f64 = 0.5;
const WARNED_S: f64 = 1.0;

/// The smallest number of rows.
const FEWEST_ROWS: u64 = 20;

/// The part of a joint's rated torque by which the torque must change for a warning. Noise and the
/// weight of a standing arm change it less.
const CHANGING_TORQUE: f64 = 0.1;

/// Finds positions that stay the same although other columns say that the joint moves.
pub(crate) struct Frozen {
    joints: Vec<Joint>,
    shortest_refused_s: f64,
    claimed_rad: f64,
}

struct Joint {
    position: Column,
    torque: Column,
    velocity: Option<Column>,
    least_torque_change: f64,
    stay: Option<Stay>,
    found: Option<Found>,
}

/// A column, and its index among the values of a sample.
struct Column {
    name: String,
    channel: usize,
}

/// Consecutive rows with the same position.
#[derive(Clone, Copy)]
struct Stay {
    position: f64,
    first: Place,
    first_s: f64,
    last: Place,
    last_s: f64,
    rows: u64,
    /// The smallest and the largest torque.
    torque: [f64; 2],
    velocity: f64,
    /// The way that the velocities claim, rad.
    claimed: f64,
}

/// The first doubtful stay of a joint, and the number of others.
struct Found {
    sentence: String,
    others: u64,
}

impl Frozen {
    pub fn new(spec: &ImportSpec) -> Self {
        let robot = spec.robot();
        let columns = &spec.columns;
        let count = columns.u.len();
        let column = |names: &[String], joint: usize, offset: usize| {
            names.get(joint).map(|name| Column { name: name.clone(), channel: offset + joint })
        };
        let joint = |(joint, description): (usize, &spec::JointDescription)| {
            Some(Joint {
                torque: column(&columns.u, joint, 0)?,
                position: column(&columns.q, joint, count)?,
                velocity: columns.qd.as_ref().and_then(|qd| column(qd, joint, 2 * count)),
                least_torque_change: CHANGING_TORQUE * description.torque_nm,
                stay: None,
                found: None,
            })
        };
        Self {
            joints: (0..).zip(&robot.description().joints).filter_map(joint).collect(),
            shortest_refused_s: REFUSED_S.max(spec.max_gap_s),
            claimed_rad: CLAIMED_RAD.max(10.0 * spec.position_noise_rad),
        }
    }

    /// Takes the next row of the recording, which `recording` names.
    ///
    /// # Errors
    /// When the velocities of a joint say for too long that its position should change.
    pub fn accept(&mut self, sample: &Sample, recording: Option<&str>) -> Result<(), RowError> {
        for joint in &mut self.joints {
            joint.accept(sample, recording);
            let Joint { stay: Some(stay), velocity: Some(velocity), position, .. } = joint else {
                continue;
            };
            let lasted = stay.last_s - stay.first_s;
            let claimed = stay.claimed.abs();
            if stay.rows >= FEWEST_ROWS
                && lasted > self.shortest_refused_s
                && claimed > self.claimed_rad
                && claimed > CLAIMED_RAD_S * lasted
            {
                let found = format!(
                    "{} rad since {}, for {} s, while column {:?} says that the joint moved by {} rad",
                    rounded(stay.position),
                    stay.first,
                    rounded(lasted),
                    velocity.name,
                    rounded(stay.claimed),
                );
                let allowed = "a position that follows its velocity: the sensor froze, or a column \
                               is wrong; let another recording begin here, or leave columns.qd out";
                return Err(RowError::value(stay.last, &position.name, found, allowed));
            }
        }
        Ok(())
    }

    /// Ends the recording.
    pub fn finish(&mut self, recording: Option<&str>) {
        for joint in &mut self.joints {
            joint.end_stay(recording);
        }
    }

    /// A sentence for each joint that may have been frozen.
    pub fn warnings(self) -> Vec<String> {
        let found = self.joints.into_iter().filter_map(|joint| joint.found);
        let sentence = |Found { sentence, others }| match others {
            0 => sentence,
            others => format!("{sentence} (and {others} more times)"),
        };
        found.map(sentence).collect()
    }
}

impl Joint {
    fn accept(&mut self, sample: &Sample, recording: Option<&str>) {
        let position = sample.values[self.position.channel];
        let torque = sample.values[self.torque.channel];
        let velocity = self.velocity.as_ref().map_or(0.0, |column| sample.values[column.channel]);
        if let Some(stay) = self.stay.as_mut().filter(|stay| stay.position == position) {
            // The mean of both velocities, as a trapezoid.
            stay.claimed += (sample.time_s - stay.last_s) * f64::midpoint(stay.velocity, velocity);
            (stay.last, stay.last_s, stay.velocity) = (sample.place, sample.time_s, velocity);
            stay.rows += 1;
            stay.torque = [stay.torque[0].min(torque), stay.torque[1].max(torque)];
            return;
        }
        self.end_stay(recording);
        self.stay = Some(Stay {
            position,
            first: sample.place,
            first_s: sample.time_s,
            last: sample.place,
            last_s: sample.time_s,
            rows: 1,
            torque: [torque; 2],
            velocity,
            claimed: 0.0,
        });
    }

    fn end_stay(&mut self, recording: Option<&str>) {
        let Some(stay) = self.stay.take() else { return };
        let [least, most] = stay.torque;
        let lasted = stay.last_s - stay.first_s;
        // A joint that its velocities say stands still is not doubtful.
        if self.velocity.is_some()
            || stay.rows < FEWEST_ROWS
            || lasted < WARNED_S
            || most - least < self.least_torque_change
        {
            return;
        }
        if let Some(found) = &mut self.found {
            found.others += 1;
            return;
        }
        let recording = recording.map(|name| format!("recording {name:?}, ")).unwrap_or_default();
        let sentence = format!(
            "{recording}{} to {}: column {:?} stays at {} rad for {} s while {:?} changes from {} \
             to {} N·m; unless the joint was held, its sensor froze",
            stay.first,
            stay.last,
            self.position.name,
            rounded(stay.position),
            rounded(lasted),
            self.torque.name,
            rounded(least),
            rounded(most),
        );
        self.found = Some(Found { sentence, others: 0 });
    }
}

//! Whether recordings can be those of an arm: units, signs, order, delay, and gravity of their
//! torques.
//!
//! A channel of torques is compared with the torques that the description's arm needs for the
//! recorded motion. Its links may differ from the description as those of [`crate::identify`] may;
//! friction, rotor inertia and offset are free. A number is told only if the motion shows it.
//!
//! All recordings are compared together, and their parts one by one. Together they have no more rows
//! than three minutes have, and neither has a part, so that the cost of long recordings is bounded.

mod beyond;
mod channel;
mod comparison;
mod cuts;
mod delay;
mod doubts;
mod layout;
mod limits;
mod parts;
mod purpose;
mod regression;
mod rows;
mod told;

use spec::RobotDescription;
use wire::LogCheck;

use crate::IdentificationError;
use crate::arm::Prior;
use crate::motion::{Motion, Recording};
use channel::Channel;
use comparison::Comparison;
use parts::Part;
pub(crate) use purpose::Purpose;
use told::{Doubted, told};

/// The edge of the low-pass for positions and torques, Hz, and the highest one as a share of the
/// rate.
const LOW_PASS_HZ: f64 = 8.0;
const LOW_PASS_SHARE: f64 = 0.125;

/// The speed at which Coulomb friction bends in an arm of which nothing is known yet, rad/s.
const FRICTION_SPEED_RAD_S: f64 = 0.05;

/// Compares recordings with the arm of a description. Recordings that are too short do not count.
///
/// # Errors
/// [`IdentificationError::Link`] when a link of the description cannot exist, and
/// [`IdentificationError::Joints`], [`IdentificationError::Lengths`] and
/// [`IdentificationError::NotFinite`] for recordings that are none of such an arm.
pub fn check_log(
    description: &RobotDescription,
    recordings: &[Recording],
) -> Result<LogCheck, IdentificationError> {
    let (found, doubts) = compare(description, recordings, Purpose::Import)?;
    Ok(LogCheck {
        seconds: found.seconds,
        doubts,
        channels: found.channels.iter().map(Channel::report).collect(),
    })
}

/// The doubts about recordings that their `purpose` does not settle.
///
/// # Errors
/// See [`check_log`].
pub(crate) fn doubts_before_fit(
    description: &RobotDescription,
    recordings: &[Recording],
    purpose: Purpose,
) -> Result<Vec<String>, IdentificationError> {
    let (_, doubts) = compare(description, recordings, purpose)?;
    Ok(doubts)
}

/// The findings about all recordings together, and the doubts about them and their parts.
fn compare(
    description: &RobotDescription,
    recordings: &[Recording],
    purpose: Purpose,
) -> Result<(Comparison, Vec<String>), IdentificationError> {
    let joints = description.joints.len();
    let arm = Prior::of(description, &vec![FRICTION_SPEED_RAD_S; joints], 0.0)?;
    let motions = motions(recordings, description)?;
    let whole = Comparison::of_torques(&arm, &motions).with_limits(description, &motions);
    let parts = Part::all(&motions);
    let doubted = |part: &Part| {
        let found = Comparison::of_torques(&arm, &part.motions(&motions));
        Doubted { part: part.name(&motions), doubts: doubts::of(&found, purpose) }
    };
    let of_parts: Vec<Doubted> = match parts.as_slice() {
        // The only part is the whole.
        [_] => Vec::new(),
        parts => parts.iter().map(doubted).collect(),
    };
    let doubts = told(doubts::of(&whole, purpose), &of_parts);
    Ok((whole, doubts))
}

/// The motions of the recordings that are long enough.
fn motions(
    recordings: &[Recording],
    description: &RobotDescription,
) -> Result<Vec<Motion>, IdentificationError> {
    let limits_nm = description.per_joint(|joint| joint.torque_nm);
    let mut motions = Vec::new();
    for recording in recordings {
        let low_pass_hz = LOW_PASS_HZ.min(LOW_PASS_SHARE * recording.rate_hz);
        match Motion::new(recording, &limits_nm, low_pass_hz) {
            Ok(motion) => motions.push(motion),
            Err(IdentificationError::Short { .. }) => {}
            Err(error) => return Err(error),
        }
    }
    Ok(motions)
}

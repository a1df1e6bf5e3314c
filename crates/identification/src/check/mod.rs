//! Whether recordings can be those of an arm: units, signs, order, delay, and gravity of their
//! torques.
//!
//! A channel of torques is compared with the torques that the description's arm needs for the
//! recorded motion. Its links may differ from the description as those of [`crate::identify`] may;
//! friction, rotor inertia and offset are free. A number is told only if the motion shows it.

mod channel;
mod delay;
mod doubts;
mod layout;
mod limits;
mod regression;
mod rows;

use spec::RobotDescription;
use wire::LogCheck;

use crate::arm::Prior;
use crate::motion::{Motion, Recording};
use crate::{HORIZONS_S, IdentificationError};
use channel::Channel;
use doubts::Purpose;
use layout::Layout;
use limits::Farthest;
use rows::States;

/// The most seconds of recordings that are compared: enough for delays to a fraction of a
/// millisecond.
pub const MOST_CHECKED_S: f64 = 180.0;

/// The edge of the low-pass for positions and torques, Hz, and the highest one as a share of the
/// rate.
const LOW_PASS_HZ: f64 = 8.0;
const LOW_PASS_SHARE: f64 = 0.125;

/// The speed at which Coulomb friction bends in an arm of which nothing is known yet, rad/s.
const FRICTION_SPEED_RAD_S: f64 = 0.05;

/// The findings about recordings.
struct Comparison {
    /// Length of the recordings and their longest period, s.
    seconds: f64,
    period_s: f64,
    layout: Layout,
    channels: Vec<Channel>,
    ties: Ties,
    /// How far each joint goes towards its limits. Empty if no recording is long enough.
    farthest: Vec<Farthest>,
}

/// Mistakes that may be in columns of q as well as in those of u.
struct Ties {
    is_exchange_tied: bool,
    /// Joints with another sign.
    signs: Vec<usize>,
}

/// Compares recordings with the arm of a description. Only the first [`MOST_CHECKED_S`] count, and
/// recordings that are too short do not.
///
/// # Errors
/// [`IdentificationError::Link`] when a link of the description cannot exist, and
/// [`IdentificationError::Joints`], [`IdentificationError::Lengths`] and
/// [`IdentificationError::NotFinite`] for recordings that are none of such an arm.
pub fn check_log(
    description: &RobotDescription,
    recordings: &[Recording],
) -> Result<LogCheck, IdentificationError> {
    let found = Comparison::new(description, recordings)?;
    Ok(LogCheck {
        seconds: found.seconds,
        doubts: doubts::of(&found, Purpose::Import),
        channels: found.channels.iter().map(Channel::report).collect(),
    })
}

/// The doubts about recordings of a fit that the fit itself does not settle. Gains have a standard
/// deviation of `gain_deviation`, and torques may be late by `most_delay_s`.
///
/// # Errors
/// See [`check_log`].
pub(crate) fn doubts_before_fit(
    description: &RobotDescription,
    recordings: &[Recording],
    gain_deviation: f64,
    most_delay_s: f64,
) -> Result<Vec<String>, IdentificationError> {
    let found = Comparison::new(description, recordings)?;
    Ok(doubts::of(&found, Purpose::Identification { gain_deviation, most_delay_s }))
}

impl Comparison {
    fn new(
        description: &RobotDescription,
        recordings: &[Recording],
    ) -> Result<Self, IdentificationError> {
        let joints = description.joints.len();
        let arm = Prior::of(description, vec![FRICTION_SPEED_RAD_S; joints], 0.0)?;
        let motions = motions(recordings, joints)?;
        let states = States::new(&motions);
        let few = states.thinned(layout::ROWS);
        let mut layout = Layout::find(&arm, &few);
        let is_exchange_tied = layout.settle_exchange(&arm, &few);
        let mut ties = Ties { is_exchange_tied, signs: Vec::new() };
        let mut channels = Channel::all(&arm, &states, &layout);
        let before = layout.clone();
        for joint in 0..joints {
            let is_turned =
                layout.has_declared_sign(joint) && channels[layout.torques[joint]].sign == Some(-1);
            if is_turned && layout.settle_sign(joint, &arm, &few) {
                ties.signs.push(joint);
            }
        }
        if layout != before {
            channels = Channel::all(&arm, &states, &layout);
        }
        Ok(Self {
            seconds: motions.iter().map(|motion| motion.samples() as f64 / motion.rate_hz).sum(),
            period_s: states.period_s(),
            layout,
            channels,
            ties,
            farthest: Farthest::of(description, &motions),
        })
    }
}

/// The motions of the first recordings that are long enough.
fn motions(recordings: &[Recording], joints: usize) -> Result<Vec<Motion>, IdentificationError> {
    let mut left_s = MOST_CHECKED_S;
    let mut motions = Vec::new();
    for recording in recordings {
        let low_pass_hz = LOW_PASS_HZ.min(LOW_PASS_SHARE * recording.rate_hz);
        if left_s < 2.0 * HORIZONS_S[HORIZONS_S.len() - 1] {
            break;
        }
        match Motion::new(recording, joints, low_pass_hz) {
            Ok(motion) => {
                let motion = motion.beginning(left_s);
                left_s -= motion.samples() as f64 / motion.rate_hz;
                motions.push(motion);
            }
            Err(IdentificationError::Short { .. }) => {}
            Err(error) => return Err(error),
        }
    }
    Ok(motions)
}

use thiserror::Error;

use crate::wording::rounded;

/// Why recordings give no parameters.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum IdentificationError {
    /// A recording has another number of joints than the arm.
    #[error("recording {recording:?} has {found} joints, the arm has {allowed}")]
    Joints {
        /// The recording's name.
        recording: String,
        /// Its number of joints.
        found: usize,
        /// The arm's number of joints.
        allowed: usize,
    },
    /// A recording has more samples of one column than of the other.
    #[error(
        "recording {recording:?} has {q} samples of positions and {u} of torques, allowed: as many"
    )]
    Lengths {
        /// The recording's name.
        recording: String,
        /// Samples of positions.
        q: usize,
        /// Samples of torques.
        u: usize,
    },
    /// A recording is shorter than the longest horizon.
    #[error("recording {recording:?} lasts {seconds:.2} s, allowed: at least {least_s} s")]
    Short {
        /// The recording's name.
        recording: String,
        /// Its length, s.
        seconds: f64,
        /// The least length, s.
        least_s: f64,
    },
    /// A value is not a number.
    #[error(
        "recording {recording:?} has a value that is not finite in {column} of joint {joint}, sample {sample}"
    )]
    NotFinite {
        /// The recording's name.
        recording: String,
        /// `u` or `q`.
        column: &'static str,
        /// From 1.
        joint: usize,
        /// From 0.
        sample: usize,
    },
    /// The low-pass cannot have this edge at the recording's rate.
    #[error(
        "low_pass_hz is {low_pass_hz} Hz, allowed for recording {recording:?} at {} Hz: above 0 and below {} Hz",
        rounded(*rate_hz),
        rounded(*below_hz)
    )]
    LowPass {
        /// The recording's name.
        recording: String,
        /// The edge, Hz.
        low_pass_hz: f64,
        /// The recording's rate, Hz.
        rate_hz: f64,
        /// The bound, Hz.
        below_hz: f64,
    },
    /// Recordings have different rates.
    #[error(
        "recording {recording:?} has {rate_hz} Hz, allowed: {allowed_hz} Hz as the first recording"
    )]
    Rates {
        /// The recording's name.
        recording: String,
        /// Its rate, Hz.
        rate_hz: f64,
        /// The first recording's rate, Hz.
        allowed_hz: f64,
    },
    /// A joint never moves, so its friction and rotor cannot be seen.
    #[error(
        "joint {joint} moves by {range_rad:.2e} rad in all recordings, allowed: at least {least_rad} rad; lock a joint \
         that stands still: `torqued robot add ARM.urdf --lock {name}={position_rad}`, and leave it out of columns.q and \
         columns.u of the import"
    )]
    Still {
        /// From 1.
        joint: usize,
        /// Its name in the description.
        name: String,
        /// The position at which it stands, rad.
        position_rad: f64,
        /// The range of its positions, rad.
        range_rad: f64,
        /// The least range, rad.
        least_rad: f64,
    },
    /// A link of the description cannot exist.
    #[error("link {link} of the description has an inertia that no body can have")]
    Link {
        /// From 1.
        link: usize,
    },
    /// The caller of the search has ended it.
    #[error("stopped on request")]
    Stopped,
    /// There is nothing to learn from.
    #[error("there are no recordings")]
    NoRecordings,
}

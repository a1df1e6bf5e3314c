use thiserror::Error;

use crate::IdentificationError;

/// Why an arm gets no exciting motion.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ExcitationError {
    /// A setting has a value that is not allowed.
    #[error("{name} is {value}, allowed: {allowed}")]
    Setting {
        /// Its flag of `torqued excite`; `random_motions` has none.
        name: &'static str,
        /// Its value.
        value: f64,
        /// The allowed values.
        allowed: String,
    },
    /// A list has another length than the arm has joints.
    #[error("{name} has {found} numbers, allowed: {joints}, one per joint")]
    Count {
        /// Its flag of `torqued excite`.
        name: &'static str,
        /// Its length.
        found: usize,
        /// The arm's number of joints.
        joints: usize,
    },
    /// A number of a list is not allowed.
    #[error("{name} of joint {joint} is {value}, allowed: {least} to {most}")]
    OfJoint {
        /// Its flag of `torqued excite`.
        name: &'static str,
        /// From 1.
        joint: usize,
        /// Its value.
        value: f64,
        /// The smallest value.
        least: f64,
        /// The largest value.
        most: f64,
    },
    /// A joint has no room to move.
    #[error(
        "joints[{index}].position_rad ({name}) leaves {room_rad:.3} rad within the margin of {margin}, allowed: at \
         least {least_rad} rad; widen the limits, or lock the joint with --lock"
    )]
    Room {
        /// From 0, as in the description.
        index: usize,
        /// The joint's name.
        name: String,
        /// The width of its range within the margin, rad.
        room_rad: f64,
        /// The share of every limit that stays free.
        margin: f64,
        /// The least width, rad.
        least_rad: f64,
    },
    /// Friction alone takes the whole torque.
    #[error(
        "joints[{index}].torque_nm ({name}) is {torque_nm} N·m, allowed with a margin of {margin}: more than {least_nm:.3} \
         N·m, which its Coulomb friction takes"
    )]
    Friction {
        /// From 0, as in the description.
        index: usize,
        /// The joint's name.
        name: String,
        /// The torque limit, N·m.
        torque_nm: f64,
        /// The share of every limit that stays free.
        margin: f64,
        /// The least torque, N·m.
        least_nm: f64,
    },
    /// No posture is clear of the table.
    #[error(
        "--table-z is {table_z_m} m, allowed with a clearance of {clearance_m} m: below {highest_m:.3} m, so that a posture \
         keeps the joints from the third on and the hand above the table"
    )]
    Table {
        /// The table's height, m.
        table_z_m: f64,
        /// The distance to keep from it, m.
        clearance_m: f64,
        /// A height below which there are postures, m.
        highest_m: f64,
    },
    /// A joint cannot hold the arm.
    #[error(
        "joints[{index}].torque_nm ({name}) is {torque_nm} N·m, allowed with a margin of {margin}: more than {least_nm:.2} \
         N·m, so that the arm is held in a posture that is clear of the table"
    )]
    Hold {
        /// From 0, as in the description.
        index: usize,
        /// The joint's name.
        name: String,
        /// The torque limit, N·m.
        torque_nm: f64,
        /// The share of every limit that stays free.
        margin: f64,
        /// The torque that the best posture needs, N·m.
        least_nm: f64,
    },
    /// The limits leave room for postures, but for no motion.
    #[error(
        "none of {random_motions} random motions stays within the limits at all times, allowed: limits with room around a \
         posture; widen positions, velocities, accelerations or torques, or lower the table"
    )]
    NoMotion {
        /// Their number.
        random_motions: usize,
    },
    /// The caller of the search has ended it.
    #[error("stopped on request")]
    Stopped,
    /// The description's arm cannot be identified at all.
    #[error(transparent)]
    Arm(#[from] IdentificationError),
}

/// The measurement noise: standard deviations of the errors of measured values, 0 where none is
/// known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MeasurementNoise {
    /// rad.
    pub position_rad: f64,
    /// N·m.
    pub torque_nm: f64,
    /// Noise of the last position of a context, rad. It is larger than that of other positions where
    /// these are means of samples on both sides ([`crate::Decimated`]).
    pub last_position_rad: f64,
}

impl MeasurementNoise {
    /// Noise that is alike at all positions, rad, and torques, N·m.
    #[must_use]
    pub const fn new(position_rad: f64, torque_nm: f64) -> Self {
        Self { position_rad, torque_nm, last_position_rad: position_rad }
    }

    /// The sum of two independent noises.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            position_rad: self.position_rad.hypot(other.position_rad),
            torque_nm: self.torque_nm.hypot(other.torque_nm),
            last_position_rad: self.last_position_rad.hypot(other.last_position_rad),
        }
    }
}

/// The measurement noise: standard deviations of the errors of measured values, 0 where none is
/// known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MeasurementNoise {
    /// rad.
    pub position_rad: f64,
    /// N·m.
    pub torque_nm: f64,
}

impl MeasurementNoise {
    /// The sum of two independent noises.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            position_rad: self.position_rad.hypot(other.position_rad),
            torque_nm: self.torque_nm.hypot(other.torque_nm),
        }
    }
}

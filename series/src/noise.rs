/// How far measured values lie from true ones: standard deviations of their errors, 0 where nothing is
/// known of any.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MeasurementNoise {
    /// rad.
    pub position_rad: f64,
    /// N·m.
    pub torque_nm: f64,
}

impl MeasurementNoise {
    /// The noise of both, which are independent.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            position_rad: self.position_rad.hypot(other.position_rad),
            torque_nm: self.torque_nm.hypot(other.torque_nm),
        }
    }
}

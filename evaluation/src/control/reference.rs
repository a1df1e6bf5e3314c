use dynamics::{JOINT_LIMITS_RAD, Joints};
use spec::ControlPath;

/// Where a robot is to be, from the moment control begins.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    path: ControlPath,
    start: Joints<f64>,
    /// 1 or -1, to where there is more room.
    side: Joints<f64>,
}

impl Reference {
    /// `start` in rad.
    pub fn new(path: &ControlPath, start: Joints<f64>) -> Self {
        let side = std::array::from_fn(|joint| {
            let limits = JOINT_LIMITS_RAD[joint];
            if start[joint] <= 0.5 * (limits.min + limits.max) { 1.0 } else { -1.0 }
        });
        Self { path: path.clone(), start, side }
    }

    /// Positions `t` seconds after control began, rad.
    pub fn at(&self, t: f64) -> Joints<f64> {
        let displacement = self.path.displacement(t);
        std::array::from_fn(|joint| self.start[joint] + self.side[joint] * displacement[joint])
    }
}

//! The path that a robot should follow.

use dynamics::Joints;
use spec::{ControlPath, Range};

/// The path that a robot should follow. It starts when control begins.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    path: ControlPath,
    start: Joints<f64>,
    /// The direction of each joint, 1 or -1, towards the farther limit.
    side: Joints<f64>,
}

impl Reference {
    /// A path from `start` within `limits`, both in rad.
    pub fn new(path: &ControlPath, start: Joints<f64>, limits: &[Range]) -> Self {
        let sides = start.iter().zip(limits).map(|(start, limits)| {
            if *start <= 0.5 * (limits.min + limits.max) { 1.0 } else { -1.0 }
        });
        Self { path: path.clone(), start, side: sides.collect() }
    }

    /// Positions `t` seconds after control began, rad.
    pub fn at(&self, t: f64) -> Joints<f64> {
        let displacement = self.path.displacement(t);
        Joints::from_fn(self.start.len(), |joint| {
            self.start[joint] + self.side[joint] * displacement[joint]
        })
    }
}

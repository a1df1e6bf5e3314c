use dynamics::Joints;
use spec::{ControlPath, Range};

/// Where a robot is to be, from the moment control begins.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    path: ControlPath,
    start: Joints<f64>,
    /// 1 or -1, to where there is more room.
    side: Joints<f64>,
}

impl Reference {
    /// `start` and `limits` of the joints in rad.
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

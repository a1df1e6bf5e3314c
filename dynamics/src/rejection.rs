use simd::Lanes;
use spec::{JOINT_LIMITS_RAD, Rejection};

use crate::Joints;

/// Positions that every sample of a trajectory must keep to.
pub(crate) struct Clearance<L> {
    lower: Joints<L>,
    upper: Joints<L>,
}

impl<L: Lanes> Clearance<L> {
    #[inline(always)]
    pub(crate) fn new(rejection: &Rejection) -> Self {
        let unlimited = L::splat(f64::INFINITY);
        let mut clearance =
            Self { lower: [-unlimited; spec::JOINTS], upper: [unlimited; spec::JOINTS] };
        if let Some(margin) = rejection.position_margin_rad {
            for (joint, limits) in JOINT_LIMITS_RAD.iter().enumerate() {
                clearance.lower[joint] = L::splat(limits.min + margin);
                clearance.upper[joint] = L::splat(limits.max - margin);
            }
        }
        clearance
    }

    /// How far the worst joint lies outside, in rad; negative when all are inside.
    #[inline(always)]
    pub(crate) fn excess(&self, q: &Joints<L>) -> L {
        let mut excess = (q[0] - self.upper[0]).max(self.lower[0] - q[0]);
        for joint in 1..spec::JOINTS {
            let beyond = (q[joint] - self.upper[joint]).max(self.lower[joint] - q[joint]);
            excess = excess.max(beyond);
        }
        excess
    }
}

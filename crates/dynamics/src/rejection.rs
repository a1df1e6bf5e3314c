use simd::Lanes;
use spec::SimulateSpec;

/// The bounds that every sample of a trajectory must keep.
pub(crate) struct Clearance<L, const N: usize> {
    lower: [L; N],
    upper: [L; N],
}

impl<L: Lanes, const N: usize> Clearance<L, N> {
    #[inline(always)]
    pub(crate) fn new(spec: &SimulateSpec) -> Self {
        let unlimited = L::splat(f64::INFINITY);
        let mut clearance = Self { lower: [-unlimited; N], upper: [unlimited; N] };
        if let Some(margin) = spec.rejection.position_margin_rad {
            for (joint, description) in spec.robot.description().joints.iter().enumerate() {
                let limits = description.position_rad;
                clearance.lower[joint] = L::splat(limits.min + margin);
                clearance.upper[joint] = L::splat(limits.max - margin);
            }
        }
        clearance
    }

    /// The largest distance of a joint beyond its bounds, in rad. It is negative if all are inside.
    #[inline(always)]
    pub(crate) fn excess(&self, joints: usize, q: &[L; N]) -> L {
        let mut excess = (q[0] - self.upper[0]).max(self.lower[0] - q[0]);
        for joint in 1..joints {
            let beyond = (q[joint] - self.upper[joint]).max(self.lower[joint] - q[joint]);
            excess = excess.max(beyond);
        }
        excess
    }
}

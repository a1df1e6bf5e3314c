//! Friction of the joints besides their viscous damping.

use simd::Lanes;

use crate::Joints;

/// τ_f(q̇) = φ1 / (1 + exp(−φ2 (q̇ + φ3))) − φ1 / (1 + exp(−φ2 φ3)) of each joint: zero at rest.
///
/// Source: Gaz et al. 2019, equation 19.
#[derive(Clone, Debug, PartialEq)]
pub struct Friction {
    /// φ1, N·m.
    pub phi1_nm: Joints<f64>,
    /// φ2, s/rad.
    pub phi2_s_rad: Joints<f64>,
    /// φ3, rad/s.
    pub phi3_rad_s: Joints<f64>,
}

impl Friction {
    pub(crate) fn nominal(spec: &spec::Friction) -> Self {
        Self {
            phi1_nm: spec.phi1_nm.as_slice().into(),
            phi2_s_rad: spec.phi2_s_rad.as_slice().into(),
            phi3_rad_s: spec.phi3_rad_s.as_slice().into(),
        }
    }
}

/// The friction of one robot per lane.
pub(crate) struct Sigmoids<L, const N: usize> {
    phi1: [L; N],
    phi2: [L; N],
    phi3: [L; N],
    /// φ1 / (1 + exp(−φ2 φ3)), computed in the same way as for a moving joint, so that friction at
    /// rest is exactly 0.
    at_rest: [L; N],
}

impl<L: Lanes, const N: usize> Sigmoids<L, N> {
    #[inline(always)]
    pub(crate) fn none() -> Self {
        let zero = [L::splat(0.0); N];
        Self { phi1: zero, phi2: zero, phi3: zero, at_rest: zero }
    }

    #[inline(always)]
    pub(crate) fn set_lane(&mut self, joints: usize, lane: usize, friction: Option<&Friction>) {
        for joint in 0..joints {
            let [phi1, phi2, phi3] = match friction {
                Some(friction) => [
                    friction.phi1_nm[joint],
                    friction.phi2_s_rad[joint],
                    friction.phi3_rad_s[joint],
                ],
                None => [0.0; 3],
            };
            self.phi1[joint].set_lane(lane, phi1);
            self.phi2[joint].set_lane(lane, phi2);
            self.phi3[joint].set_lane(lane, phi3);
            self.at_rest[joint] = self.phi1[joint] * sigmoid(self.phi2[joint] * self.phi3[joint]);
        }
    }

    /// Torque against the motion of `joint` at `qd` (rad/s), N·m.
    #[inline(always)]
    pub(crate) fn torque(&self, joint: usize, qd: L) -> L {
        let sigmoid = sigmoid(self.phi2[joint] * (qd + self.phi3[joint]));
        self.phi1[joint] * sigmoid - self.at_rest[joint]
    }
}

/// 1 / (1 + exp(−x)).
#[inline(always)]
fn sigmoid<L: Lanes>(x: L) -> L {
    /// Here exp(−x) is far below the last place of 1, and its inverse is still in the range of f32.
    const SATURATED: f64 = 80.0;

    let saturated = L::splat(SATURATED);
    let bounded = (-(x.max(-saturated))).max(-saturated);
    (L::splat(1.0) + bounded.exp()).recip()
}

#[cfg(test)]
mod tests {
    use simd::{F32Array, F64Array};

    use super::*;

    /// The formula as published.
    fn published([phi1, phi2, phi3]: [f64; 3], qd: f64) -> f64 {
        phi1 / (1.0 + (-phi2 * (qd + phi3)).exp()) - phi1 / (1.0 + (-phi2 * phi3).exp())
    }

    fn check<L: Lanes>(tolerance_nm: f64) {
        let spec = spec::Friction::default();
        let friction = Friction::nominal(&spec);
        let mut sigmoids = Sigmoids::<L, 7>::none();
        sigmoids.set_lane(7, 0, Some(&friction));
        for joint in 0..7 {
            let phi = [spec.phi1_nm[joint], spec.phi2_s_rad[joint], spec.phi3_rad_s[joint]];
            assert_eq!(sigmoids.torque(joint, L::splat(0.0)).lane(0), 0.0);
            for step in -3000..=3000 {
                let qd = f64::from(step) * 0.001;
                let torque = sigmoids.torque(joint, L::splat(qd));
                assert!((torque.lane(0) - published(phi, qd)).abs() < tolerance_nm, "{joint} {qd}");
            }
            for (qd, sigmoid) in [(1e6, 1.0), (-1e6, 0.0)] {
                let torque = sigmoids.torque(joint, L::splat(qd));
                let expected = phi[0] * (sigmoid - 1.0 / (1.0 + (-phi[1] * phi[2]).exp()));
                assert!((torque.lane(0) - expected).abs() < tolerance_nm, "{joint} {qd}");
            }
        }
    }

    #[test]
    fn friction_is_the_published_sigmoid_and_saturates() {
        check::<F64Array<1>>(1e-15);
        check::<F32Array<1>>(1e-6);
    }
}

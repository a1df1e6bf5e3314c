//! Friction of the joints besides their viscous damping.

use spec::JOINTS;

use crate::Joints;
use crate::lanes::Lanes;

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
        Self { phi1_nm: spec.phi1_nm, phi2_s_rad: spec.phi2_s_rad, phi3_rad_s: spec.phi3_rad_s }
    }
}

/// The friction of one robot per lane.
pub(crate) struct Sigmoids<L> {
    phi1: Joints<L>,
    phi2: Joints<L>,
    phi3: Joints<L>,
    /// φ1 / (1 + exp(−φ2 φ3)), computed as for a moving joint, so that friction at rest is exactly 0.
    at_rest: Joints<L>,
}

impl<L: Lanes> Sigmoids<L> {
    #[inline(always)]
    pub(crate) fn none() -> Self {
        let zero = [L::splat(0.0); JOINTS];
        Self { phi1: zero, phi2: zero, phi3: zero, at_rest: zero }
    }

    #[inline(always)]
    pub(crate) fn set_lane(&mut self, lane: usize, friction: Option<&Friction>) {
        for joint in 0..JOINTS {
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
            let (_, sigmoid) = decay_and_sigmoid(self.phi2[joint] * self.phi3[joint]);
            self.at_rest[joint] = self.phi1[joint] * sigmoid;
        }
    }

    /// Torque against the motion of `joint` at `qd` (rad/s), N·m, and its slope, N·m·s/rad.
    #[inline(always)]
    pub(crate) fn at(&self, joint: usize, qd: L) -> (L, L) {
        let phi1 = self.phi1[joint];
        let (decay, sigmoid) = decay_and_sigmoid(self.phi2[joint] * (qd + self.phi3[joint]));
        // σ' = σ (1 − σ) = σ (exp(−x) σ).
        let slope = (phi1 * self.phi2[joint]) * (sigmoid * (decay * sigmoid));
        (phi1 * sigmoid - self.at_rest[joint], slope)
    }
}

/// exp(−x) and 1 / (1 + exp(−x)).
#[inline(always)]
fn decay_and_sigmoid<L: Lanes>(x: L) -> (L, L) {
    /// Where exp(−x) is far below the last place of 1 (or 1 below its), and still in range of f32.
    const SATURATED: f64 = 80.0;

    let saturated = L::splat(SATURATED);
    let bounded = (-(x.max(-saturated))).max(-saturated);
    let decay = bounded.exp();
    (decay, (L::splat(1.0) + decay).recip())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::{F32Array, F64Array};

    /// The formula as published.
    fn published([phi1, phi2, phi3]: [f64; 3], qd: f64) -> f64 {
        phi1 / (1.0 + (-phi2 * (qd + phi3)).exp()) - phi1 / (1.0 + (-phi2 * phi3).exp())
    }

    fn check<L: Lanes>(tolerance_nm: f64) {
        let spec = spec::Friction::default();
        let friction = Friction::nominal(&spec);
        let mut sigmoids = Sigmoids::<L>::none();
        sigmoids.set_lane(0, Some(&friction));
        for joint in 0..JOINTS {
            let phi = [spec.phi1_nm[joint], spec.phi2_s_rad[joint], spec.phi3_rad_s[joint]];
            assert_eq!(sigmoids.at(joint, L::splat(0.0)).0.lane(0), 0.0);
            for step in -3000..=3000 {
                let qd = f64::from(step) * 0.001;
                let (torque, slope) = sigmoids.at(joint, L::splat(qd));
                assert!((torque.lane(0) - published(phi, qd)).abs() < tolerance_nm, "{joint} {qd}");
                let expected = (published(phi, qd + 1e-5) - published(phi, qd - 1e-5)) / 2e-5;
                assert!((slope.lane(0) - expected).abs() < 1e-5, "slope {joint} {qd}");
            }
            for (qd, sigmoid) in [(1e6, 1.0), (-1e6, 0.0)] {
                let (torque, slope) = sigmoids.at(joint, L::splat(qd));
                let expected = phi[0] * (sigmoid - 1.0 / (1.0 + (-phi[1] * phi[2]).exp()));
                assert!((torque.lane(0) - expected).abs() < tolerance_nm, "{joint} {qd}");
                assert!(slope.lane(0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn friction_is_the_published_sigmoid_with_its_slope_and_saturates() {
        check::<F64Array<1>>(1e-15);
        check::<F32Array<1>>(1e-6);
    }
}

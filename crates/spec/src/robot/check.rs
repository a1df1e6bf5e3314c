//! Checks the descriptions of robots.

use super::description::{
    BaseDescription, BodyDescription, HandDescription, JointDescription, JointFriction,
};
use super::description::{MAX_JOINTS, Randomization, RobotDescription};
use super::initial_state::InitialState;
use crate::check::{Check, Violations};
use crate::{RobotModel, SpecError};

const LENGTH_M: std::ops::RangeInclusive<f64> = -10.0..=10.0;
const ANGLE_DEG: std::ops::RangeInclusive<f64> = -360.0..=360.0;
const FRACTION: std::ops::RangeInclusive<f64> = 0.0..=0.9;
/// Dampings of joints, N·m·s/rad.
pub(crate) const DAMPING_NM_S_RAD: std::ops::RangeInclusive<f64> = 0.0..=1000.0;
/// Rotor inertias of joints, kg·m². A large industrial arm has some tens.
pub(crate) const ARMATURE_KG_M2: std::ops::RangeInclusive<f64> = 0.0..=10_000.0;
/// Twice the Coulomb friction of joints, N·m.
pub(crate) const PHI1_NM: std::ops::RangeInclusive<f64> = 0.0..=100_000.0;
/// The steepness of friction at rest, s/rad.
pub(crate) const PHI2_S_RAD: std::ops::RangeInclusive<f64> = 0.0..=1000.0;
/// The velocity without friction, rad/s.
pub(crate) const PHI3_RAD_S: std::ops::RangeInclusive<f64> = -10.0..=10.0;
const NAME: std::ops::RangeInclusive<usize> = 1..=200;

impl RobotDescription {
    /// Checks a description that does not come from a spec.
    ///
    /// # Errors
    /// All violations, with their fields as seen from the description.
    pub fn checked(&self) -> Result<(), SpecError> {
        let mut violations = Violations::default();
        self.check(&mut violations);
        violations.finish()
    }
}

impl Check for RobotModel {
    fn check(&self, violations: &mut Violations) {
        if let Self::Described(description) = self {
            description.check(violations);
        }
    }
}

impl Check for RobotDescription {
    fn check(&self, violations: &mut Violations) {
        violations.length("name.length", self.name.len(), NAME);
        if !(1..=MAX_JOINTS).contains(&self.joints.len()) {
            let allowed = format!("1 to {MAX_JOINTS} joints");
            violations.add("joints", format!("{} joints", self.joints.len()), allowed);
        }
        for (i, joint) in self.joints.iter().enumerate() {
            violations.part(&format!("joints[{i}]"), joint);
        }
        let names = self.per_joint(|joint| &joint.name);
        violations.no_duplicates("joints.name", &names);
        violations.part("base", &self.base);
        violations.part("hand", &self.hand);
        violations.part("randomization", &self.randomization);
        violations.part("initial_state", &self.initial_state);
        violations.one_per_joint(
            "initial_state.center_rad",
            &self.initial_state.center_rad,
            self.joints.len(),
        );
    }
}

impl Check for BaseDescription {
    fn check(&self, violations: &mut Violations) {
        violations.all_within("position_m", &self.position_m, &(-1000.0..=1000.0));
        violations.all_within("rpy_deg", &self.rpy_deg, &ANGLE_DEG);
    }
}

impl Check for JointDescription {
    fn check(&self, violations: &mut Violations) {
        violations.length("name.length", self.name.len(), NAME);
        violations.within("a_m", self.a_m, LENGTH_M);
        violations.within("alpha_deg", self.alpha_deg, ANGLE_DEG);
        violations.within("d_m", self.d_m, LENGTH_M);
        violations.within("offset_deg", self.offset_deg, ANGLE_DEG);
        violations.all_within("shift_m", &self.shift_m, &LENGTH_M);
        violations.interval("position_rad", self.position_rad, &(-100.0..=100.0));
        if self.position_rad.max - self.position_rad.min < 1e-3 {
            let range = self.position_rad.max - self.position_rad.min;
            violations.add("position_rad", format!("{range} rad wide"), "at least 0.001 rad");
        }
        violations.within("velocity_rad_s", self.velocity_rad_s, 1e-3..=1000.0);
        violations.within("torque_nm", self.torque_nm, 1e-3..=1e5);
        violations.within("damping_nm_s_rad", self.damping_nm_s_rad, DAMPING_NM_S_RAD);
        violations.within("armature_kg_m2", self.armature_kg_m2, ARMATURE_KG_M2);
        violations.within("multisine_divisor", self.multisine_divisor, 0.01..=100.0);
        if let Some(inertia) = self.least_inertia_kg_m2 {
            violations.within("least_inertia_kg_m2", inertia, 1e-9..=1e4);
        }
        if let Some(friction) = &self.friction {
            violations.part("friction", friction);
        }
        violations.part("link", &self.link);
    }
}

impl Check for JointFriction {
    fn check(&self, violations: &mut Violations) {
        violations.within("phi1_nm", self.phi1_nm, PHI1_NM);
        violations.within("phi2_s_rad", self.phi2_s_rad, PHI2_S_RAD);
        violations.within("phi3_rad_s", self.phi3_rad_s, PHI3_RAD_S);
    }
}

impl Check for HandDescription {
    fn check(&self, violations: &mut Violations) {
        violations.length("contents.length", self.contents.len(), 0..=200);
        violations.within("a_m", self.a_m, LENGTH_M);
        violations.within("alpha_deg", self.alpha_deg, ANGLE_DEG);
        violations.all_within("shift_m", &self.shift_m, &LENGTH_M);
        violations.within("flange_m", self.flange_m, LENGTH_M);
        violations.within("yaw_deg", self.yaw_deg, ANGLE_DEG);
        violations.length("bodies", self.bodies.len(), 0..=16);
        for (i, body) in self.bodies.iter().enumerate() {
            violations.length(&format!("bodies[{i}].name.length"), body.name.len(), NAME);
            violations.all_within(&format!("bodies[{i}].position_m"), &body.position_m, &LENGTH_M);
            violations.part(&format!("bodies[{i}].body"), &body.body);
        }
    }
}

impl Check for Randomization {
    fn check(&self, violations: &mut Violations) {
        violations.within("mass_fraction", self.mass_fraction, FRACTION);
        violations.within("com_fraction", self.com_fraction, FRACTION);
        violations.within("inertia_fraction", self.inertia_fraction, FRACTION);
        violations.within("damping_fraction", self.damping_fraction, FRACTION);
        violations.within("armature_fraction", self.armature_fraction, FRACTION);
        violations.within("geometry_fraction", self.geometry_fraction, 0.0..=0.5);
    }
}

impl Check for InitialState {
    fn check(&self, violations: &mut Violations) {
        violations.interval("joint1_scale", self.joint1_scale, &(0.0..=1.0));
        violations.all_within("center_rad", &self.center_rad, &(-4.0..=4.0));
        violations.within("spread_rad", self.spread_rad, 0.0..=3.0);
        violations.interval("velocity_scale", self.velocity_scale, &(0.0..=10.0));
        violations.within("joint1_velocity_rad_s", self.joint1_velocity_rad_s, 0.0..=10.0);
        violations.within("velocity_rad_s", self.velocity_rad_s, 0.0..=10.0);
    }
}

impl Check for BodyDescription {
    fn check(&self, violations: &mut Violations) {
        let before = violations.count();
        violations.within("mass_kg", self.mass_kg, 1e-6..=1e4);
        violations.all_within("center_m", &self.center_m, &LENGTH_M);
        violations.all_within("inertia_kg_m2", &self.inertia_kg_m2, &(-1e4..=1e4));
        if violations.count() == before && !self.nearest_physical && !self.has_second_moments() {
            violations.add(
                "inertia_kg_m2",
                format!("{:?}", self.inertia_kg_m2),
                "[xx, xy, xz, yy, yz, zz] of a body: positive definite, no principal moment above the sum of \
                 the other two; \"nearest_physical\": true takes the nearest that is",
            );
        }
    }
}

impl BodyDescription {
    /// Whether Σ = ½ tr(I) 1 − I, the second moments of the mass, is positive definite. This holds
    /// for every body that is not flat (Wensing, Kim and Slotine 2018). The test uses the leading
    /// minors.
    pub fn has_second_moments(&self) -> bool {
        let [xx, xy, xz, yy, yz, zz] = self.inertia_kg_m2;
        let half_trace = 0.5 * (xx + yy + zz);
        let [a, b, c] = [half_trace - xx, half_trace - yy, half_trace - zz];
        let minor = a * b - xy * xy;
        // The off-diagonal entries of Σ are those of I with the opposite sign.
        let determinant = c * minor - a * yz * yz - b * xz * xz - 2.0 * xy * xz * yz;
        a > 0.0 && minor > 0.0 && determinant > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body(inertia_kg_m2: [f64; 6]) -> BodyDescription {
        BodyDescription { mass_kg: 1.0, center_m: [0.0; 3], inertia_kg_m2, nearest_physical: false }
    }

    #[test]
    fn inertias_of_bodies_pass_and_others_do_not() {
        assert!(body([1.0, 0.0, 0.0, 1.0, 0.0, 1.9]).has_second_moments());
        assert!(
            body([0.70337, -0.000139, 0.006772, 0.70661, 0.019169, 0.009117]).has_second_moments()
        );
        assert!(!body([1.0, 0.0, 0.0, 1.0, 0.0, 2.1]).has_second_moments(), "triangle inequality");
        assert!(
            !body([1.0, 1.1, 0.0, 1.0, 0.0, 1.0]).has_second_moments(),
            "not positive definite"
        );
        assert!(!body([-1.0, 0.0, 0.0, -1.0, 0.0, -1.0]).has_second_moments(), "negative");
        // The Panda's hand as published.
        assert!(!body([0.002462, -2e-6, -1e-6, 0.000492, -1.5e-5, 0.000691]).has_second_moments());
    }
}

//! Whether an integration scheme can follow the motions of a simulation, and warnings if it cannot.
//!
//! Numbers are 99th percentiles, over robots, of the largest position error within 400 samples at
//! 60 Hz. Those of controlled arms are of 400 samples at 1020 control periods per second. `cargo run --release -p dynamics --example errors` measures them over damping, gravity,
//! friction and excitation. A motion is followed if its error is below 10⁻⁴ rad.

use super::integrator::Integrator;
use super::robot_spec::{Gravity, RobotSpec};
use super::spec::SimulateSpec;
use crate::check::Violations;
use crate::doubt::Doubt;

/// Runge-Kutta of order 4 is stable if a step is shorter than this many time constants of the
/// fastest decay. It is the method's interval of stability on the negative real axis.
const RUNGE_KUTTA_LIMIT: f64 = 2.785;

impl SimulateSpec {
    /// Warnings about a valid spec that the integrator cannot follow, that the robots cannot do, or
    /// that leaves out friction of the robot.
    pub fn doubts(&self) -> Vec<Doubt> {
        let mut doubts = self.doubts_of_motion();
        doubts.extend(self.robot.friction_doubt());
        doubts
    }

    fn doubts_of_motion(&self) -> Vec<Doubt> {
        let mut doubts = Vec::new();
        let mut doubt = |field: &str, value: String, reason: String| {
            doubts.push(Doubt { field: field.to_owned(), value, reason });
        };
        let robot = &self.robot;
        if self.controller.is_some() {
            if let Some(reason) = self.closed_loop_doubt() {
                doubt("integrator", self.integrator.to_string(), reason);
            }
            return doubts;
        }
        let least_damping = robot.least_damping();

        if least_damping < 1.0 {
            doubt(
                "robot.damping_nm_s_rad",
                format!("down to {least_damping}"),
                "below 1 N·m·s/rad, arms that reach their joint limits move chaotically: at 0.5, \
                 accurate schemes differ by 0.001 to 10 rad within 400 samples, so a trajectory is \
                 only one of the possible motions; chirps that stay inside the limits are still \
                 followed to 1e-4 rad with {\"scheme\": \"rk4\", \"substeps\": 12}"
                    .to_owned(),
            );
        }
        if let Some(reason) = self.integrator_doubt(least_damping) {
            doubt("integrator", self.integrator.to_string(), reason);
        }
        if robot.gravity == Gravity::On
            && self.rejection.position_margin_rad.is_some()
            && f64::from(self.samples) / self.rate_hz > 2.0
        {
            doubt(
                "robot.gravity",
                "on".to_owned(),
                "gravity pulls the arm onto its joint limits: with the default excitations, at \
                 every damping from 0.1 to 30 N·m·s/rad, no draw kept away from them for 400 \
                 samples at 60 Hz, so the simulation fails when rejection.max_draws are used up; \
                 compensate gravity, or set rejection.position_margin_rad to null"
                    .to_owned(),
            );
        }
        doubts.extend(self.speed_doubts());
        doubts
    }

    /// Why the integrator may not follow this spec to 10⁻⁴ rad.
    fn integrator_doubt(&self, least_damping: f64) -> Option<String> {
        let per_sixtieth = |substeps: u32| f64::from(substeps) * self.rate_hz / 60.0;
        match self.integrator {
            Integrator::Reference => Some(
                "this reproduces the paper's simulator and is not accurate: at damping 10, errors \
                 are 0.002 to 0.005 rad without gravity and 0.01 to 0.03 rad with it, and at \
                 damping 1 they grow to more than 1 rad"
                    .to_owned(),
            ),
            Integrator::Extrapolated { order: order @ 1..=2, .. } => Some(format!(
                "order {order} leaves errors of {} rad at damping 10 with one substep; order 4 leaves 2e-5",
                if order == 1 { "0.005 to 0.05" } else { "0.0004 to 0.005" },
            )),
            Integrator::Extrapolated { substeps, .. }
                if self.robot.friction.is_some() && least_damping * per_sixtieth(substeps) < 30.0 =>
            {
                Some(format!(
                    "extrapolation needs smooth motions, and friction changes abruptly where \
                     joints change direction: errors reach 5e-4 rad with one substep and 6e-5 with \
                     four at damping 10, and 0.003 and 4e-4 at damping 2; {RUNGE_KUTTA} leaves 1e-4 \
                     at damping 2 to 10"
                ))
            }
            Integrator::Extrapolated { order: 3, substeps }
                if least_damping * per_sixtieth(substeps) < 20.0 =>
            {
                Some(
                    "order 3 with one substep leaves errors of 5e-5 to 3e-4 rad at damping 10 and up to 0.05 at \
                     damping 2; order 4 leaves 2e-5 and 0.004"
                        .to_owned(),
                )
            }
            Integrator::Extrapolated { substeps, .. }
                if least_damping * per_sixtieth(substeps) < 6.0 =>
            {
                Some(format!(
                    "the steps are too long for a damping of {least_damping} N·m·s/rad: with one \
                     substep, errors reach 2e-4 rad at damping 5, 0.004 at 2 and more than 0.1 at \
                     1; {RUNGE_KUTTA} leaves 1e-5 at 2 and above"
                ))
            }
            Integrator::Extrapolated { .. } => None,
            Integrator::Midpoint { substeps } => (per_sixtieth(substeps) < 8.0).then(|| {
                "this is for the short steps of controllers: at damping 10 it leaves errors of 0.002 \
                 rad with one step per 1/60 s, 1e-4 with four and 3e-5 with eight"
                    .to_owned()
            }),
            Integrator::Rk4 { substeps } => self
                .near_instability(substeps)
                .or_else(|| self.runge_kutta_too_coarse(per_sixtieth(substeps))),
        }
    }

    /// Why the integrator may not follow a controlled arm to 10⁻⁴ rad.
    fn closed_loop_doubt(&self) -> Option<String> {
        match self.integrator {
            Integrator::Reference | Integrator::Extrapolated { order: 1, .. } => Some(
                "of 512 arms of panda-real without noise, steps of order 1 left 1 % with errors above \
                 4e-4 rad, and one with 0.008; {\"scheme\": \"midpoint\"} leaves 7e-6 in the same time"
                    .to_owned(),
            ),
            Integrator::Extrapolated { .. } | Integrator::Midpoint { .. } => None,
            Integrator::Rk4 { substeps } => self.near_instability(substeps),
        }
    }

    /// Why some of the possible arms may diverge although the nominal one does not.
    fn near_instability(&self, substeps: u32) -> Option<String> {
        /// Share of the limit that counts as safe. The smallest inertias are given for joints, and
        /// those of arms are slightly smaller.
        const SAFE: f64 = 0.95;

        if !self.robot.has_least_inertias() {
            return Some(
                "the robot's description does not have least_inertia_kg_m2 for every joint, so it \
                 is not known whether explicit steps are stable; one unstable arm fails its shard"
                    .to_owned(),
            );
        }
        let (joint, rate) = self.robot.fastest_decay(Draw::Extreme);
        let step = 1.0 / (self.torque_rate_hz() * f64::from(substeps));
        (rate * step > SAFE * RUNGE_KUTTA_LIMIT).then(|| {
            format!(
                "joint {} loses its velocity at up to {rate:.0} /s in the lightest possible arms; \
                 steps of {step:.1e} s make these unstable, or nearly so (the limit is \
                 {RUNGE_KUTTA_LIMIT} / {step:.1e} s = {:.0} /s), and one unstable arm fails its \
                 shard; use {} substeps",
                joint + 1,
                RUNGE_KUTTA_LIMIT / step,
                self.stable_substeps(rate / SAFE),
            )
        })
    }

    fn runge_kutta_too_coarse(&self, steps_per_sixtieth: f64) -> Option<String> {
        let (needed, errors) = match self.robot.friction {
            None => (4.0, "reach 1e-4 rad with two or three steps per 1/60 s and 0.005 with one"),
            Some(_) => (
                6.0,
                "reach 1e-4 rad with four or five steps per 1/60 s, 4e-4 with two or three and \
                     0.2 with one",
            ),
        };
        (steps_per_sixtieth < needed).then(|| {
            format!(
                "errors {errors} at damping 1 to 10, and stay within 1e-4 with {needed} or more; \
                 this spec has {steps_per_sixtieth}"
            )
        })
    }

    /// Refuses explicit damping with step sizes at which even the nominal arm diverges.
    pub(super) fn check_stability(&self, violations: &mut Violations) {
        let Integrator::Rk4 { substeps } = self.integrator else { return };
        let (joint, rate) = self.robot.fastest_decay(Draw::Nominal);
        if rate / (self.torque_rate_hz() * f64::from(substeps)) <= RUNGE_KUTTA_LIMIT {
            return;
        }
        let needed = self.stable_substeps(rate);
        let remedy = if needed <= 64.0 {
            format!("at least {needed}, or {{\"scheme\": \"extrapolated\"}}")
        } else {
            "{\"scheme\": \"extrapolated\"}".to_owned()
        };
        violations.add(
            "integrator.substeps",
            substeps,
            format!(
                "{remedy}: joint {} loses its velocity at {rate:.0} /s, and explicit steps of more than \
                 {RUNGE_KUTTA_LIMIT} time constants diverge",
                joint + 1
            ),
        );
    }

    /// The smallest number of stable Runge-Kutta steps per sample, for a decay with `rate` per
    /// second.
    fn stable_substeps(&self, rate: f64) -> f64 {
        (rate / (self.torque_rate_hz() * RUNGE_KUTTA_LIMIT)).ceil()
    }
}

/// The integrator to use where extrapolation does not follow.
const RUNGE_KUTTA: &str = "{\"scheme\": \"rk4\", \"substeps\": 6}";

#[derive(Clone, Copy)]
enum Draw {
    Nominal,
    /// The largest damping and the smallest inertia that the fractions allow.
    Extreme,
}

impl RobotSpec {
    /// The smallest damping of any joint of any robot.
    fn least_damping(&self) -> f64 {
        let nominal = self.damping_nm_s_rad.iter().copied().fold(f64::INFINITY, f64::min);
        nominal * (1.0 - self.damping_fraction)
    }

    /// The joint with the fastest decay through damping, counted from 0, and its rate per second.
    /// The rate is 0 if the smallest inertias are not known.
    fn fastest_decay(&self, draw: Draw) -> (usize, f64) {
        let fraction = |fraction: f64| match draw {
            Draw::Nominal => 0.0,
            Draw::Extreme => fraction,
        };
        // In measurements, inertia falls by less than the largest of these fractions.
        let lighter = self.mass_fraction.max(self.com_fraction).max(self.inertia_fraction);
        let nominal = self.damping_nm_s_rad.iter().zip(&self.armature_kg_m2);
        let joints = nominal.zip(&self.description().joints);
        let rates = joints.map(|((damping, armature), joint)| {
            let Some(least_inertia) = joint.least_inertia_kg_m2 else { return 0.0 };
            let damping = damping * (1.0 + fraction(self.damping_fraction));
            let armature = armature * (1.0 - fraction(self.armature_fraction));
            damping / (least_inertia * (1.0 - fraction(lighter)) + armature)
        });
        rates
            .enumerate()
            .fold((0, 0.0), |fastest, next| if next.1 > fastest.1 { next } else { fastest })
    }

    fn has_least_inertias(&self) -> bool {
        self.description().joints.iter().all(|joint| joint.least_inertia_kg_m2.is_some())
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::JobSpec;

    fn parse(fields: &Value) -> Result<SimulateSpec, crate::SpecError> {
        let mut spec = json!({
            "kind": "simulate", "trajectories": 1,
            "excitation": {"chirp": {"frequency_hz": {"fixed": 0.3}}},
        });
        if let (Some(spec), Some(fields)) = (spec.as_object_mut(), fields.as_object()) {
            spec.extend(fields.clone());
        }
        match crate::parse(spec.to_string().as_bytes())? {
            JobSpec::Simulate(spec) => Ok(spec),
            other => panic!("{other:?}"),
        }
    }

    fn check_doubts(fields: &Value, expected: &[&str]) {
        let doubts = parse(fields).map(|spec| spec.doubts());
        let fields_in_doubt: Vec<String> =
            doubts.into_iter().flatten().map(|doubt| doubt.field).collect();
        assert_eq!(fields_in_doubt, expected, "{fields}");
    }

    #[test]
    fn the_paper_s_arm_is_beyond_doubt_and_light_damping_is_not() {
        let damping = |damping: f64| json!({"damping_nm_s_rad": vec![damping; 7]});
        check_doubts(&json!({}), &[]);
        check_doubts(&json!({"robot": damping(7.0)}), &[]);
        check_doubts(&json!({"robot": damping(3.0)}), &["integrator"]);
        check_doubts(&json!({"robot": damping(3.0), "rate_hz": 240.0}), &[]);
        check_doubts(&json!({"robot": damping(3.0), "integrator": {"scheme": "rk4"}}), &[]);
        let amplitude = "excitation.chirp.amplitude_nm";
        check_doubts(
            &json!({"robot": damping(0.5)}),
            &["robot.damping_nm_s_rad", "integrator", amplitude],
        );
        check_doubts(
            &json!({"robot": damping(0.5), "integrator": {"scheme": "rk4"}}),
            &["robot.damping_nm_s_rad", amplitude],
        );
    }

    #[test]
    fn coarse_schemes_and_friction_are_in_doubt() {
        let extrapolated = |order: u32, substeps: u32| json!({"scheme": "extrapolated", "order": order, "substeps": substeps});
        check_doubts(&json!({"integrator": {"scheme": "reference"}}), &["integrator"]);
        check_doubts(&json!({"integrator": extrapolated(2, 4)}), &["integrator"]);
        check_doubts(&json!({"integrator": extrapolated(3, 1)}), &["integrator"]);
        check_doubts(&json!({"integrator": extrapolated(3, 3)}), &[]);
        let friction = json!({"friction": {}});
        check_doubts(&json!({"robot": friction}), &["integrator"]);
        check_doubts(&json!({"robot": friction, "integrator": extrapolated(4, 4)}), &[]);
        check_doubts(&json!({"robot": friction, "integrator": {"scheme": "rk4"}}), &[]);
    }

    #[test]
    fn a_falling_arm_is_in_doubt_while_its_draws_are_rejected() {
        let on = json!({"gravity": "on"});
        check_doubts(&json!({"robot": on}), &["robot.gravity"]);
        check_doubts(&json!({"robot": on, "samples": 60}), &[]);
        check_doubts(&json!({"robot": on, "rejection": {"position_margin_rad": null}}), &[]);
        check_doubts(&json!({"robot": {"gravity": "compensated"}}), &[]);
    }

    #[test]
    fn runge_kutta_is_refused_where_it_diverges_and_doubted_just_below() {
        let spec = |substeps: u32, fraction: f64| {
            parse(&json!({
                "robot": {"damping_fraction": fraction},
                "integrator": {"scheme": "rk4", "substeps": substeps},
            }))
        };
        // 10 / (0.00466 + 0.01) = 682 per second: 2.84 time constants per step of 1/240 s.
        let error = spec(4, 0.1).map_err(|error| error.to_string()).unwrap_err();
        assert!(error.contains("integrator.substeps"), "{error}");
        assert!(error.contains("at least 5"), "{error}");
        assert!(error.contains("joint 7"), "{error}");
        assert_eq!(spec(6, 0.1).map(|spec| spec.doubts()).unwrap_or_default(), []);
        let doubts = spec(5, 0.3).map(|spec| spec.doubts()).unwrap_or_default();
        assert_eq!(doubts.len(), 1);
        assert!(doubts[0].reason.contains("use 6 substeps"), "{}", doubts[0].reason);
        check_doubts(
            &json!({
                "robot": {"damping_nm_s_rad": vec![3.0; 7]},
                "integrator": {"scheme": "rk4", "substeps": 3},
            }),
            &["integrator"],
        );
        check_doubts(
            &json!({"robot": {"friction": {}}, "integrator": {"scheme": "rk4", "substeps": 5}}),
            &["integrator"],
        );
    }
}

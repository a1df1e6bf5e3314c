//! Warnings about simulations whose joints turn faster than the robot's description allows.
//!
//! A simulated joint has no limit of velocity: nothing slows it, and no draw is rejected because of
//! its velocity. Draws that come near a limit of position are rejected.

use super::excitation::{Excitation, Frequency};
use super::spec::SimulateSpec;
use crate::Range;
use crate::doubt::Doubt;

impl SimulateSpec {
    /// Warnings about initial velocities and torques that move joints faster than their
    /// `velocity_rad_s`. At most one for each field.
    pub(super) fn speed_doubts(&self) -> Vec<Doubt> {
        let initial = self.initial_speed_doubts();
        initial.into_iter().chain(self.torque_speed_doubts()).collect()
    }

    fn initial_speed_doubts(&self) -> Vec<Doubt> {
        let initial = &self.initial_state;
        let limits = self.speed_limits();
        let scale = initial.velocity_scale.max;
        let first = ("initial_state.joint1_velocity_rad_s", initial.joint1_velocity_rad_s, 0);
        // Joints 2, 3, .. draw from one interval, so the slowest of them decides.
        let others = (1..limits.len()).min_by(|&a, &b| limits[a].total_cmp(&limits[b]));
        let others =
            others.map(|slowest| ("initial_state.velocity_rad_s", initial.velocity_rad_s, slowest));
        let too_fast = |(field, speed, joint): (&str, f64, usize)| {
            let reached = scale * speed;
            let limit = limits[joint];
            (reached > limit).then(|| Doubt {
                field: field.to_owned(),
                value: speed.to_string(),
                reason: format!(
                    "with velocity_scale up to {scale}, joint {} starts at up to {reached:.2} rad/s, \
                     beyond its limit of {limit} rad/s; use at most {}",
                    joint + 1,
                    at_most(limit / scale),
                ),
            })
        };
        [Some(first), others].into_iter().flatten().filter_map(too_fast).collect()
    }

    /// A torque u, held against the damping D, moves a joint at u / D in the end. Inertia makes
    /// this an upper limit for a torque that swings. Several components of a multisine together
    /// may exceed it.
    fn torque_speed_doubts(&self) -> Vec<Doubt> {
        let robot = &self.robot;
        let limits = self.speed_limits();
        let mut doubts = Vec::new();
        for LargestTorque { field, value, torques_nm } in self.excitation.largest_torques() {
            let speeds = limits.iter().zip(&robot.damping_nm_s_rad).enumerate().filter_map(
                |(joint, (limit, damping))| {
                    let damping = damping * (1.0 - robot.damping_fraction);
                    let torque = torques_nm.of_joint(joint)?;
                    // Without damping, the time that a torque acts decides.
                    (damping > 0.0).then_some((joint, torque, damping, *limit))
                },
            );
            let excess =
                |(_, torque, damping, limit): &(usize, f64, f64, f64)| torque / damping / limit;
            // The first of joints that are equal.
            let fastest = speeds.min_by(|a, b| excess(b).total_cmp(&excess(a)));
            let Some((joint, torque, damping, limit)) = fastest else { continue };
            if torque / damping > limit {
                doubts.push(Doubt {
                    field: field.to_owned(),
                    value,
                    reason: format!(
                        "torques of up to {torque:.3} N·m move joint {} at up to {:.2} rad/s, against \
                         a damping of {damping:.3} N·m·s/rad, beyond its limit of {limit} rad/s; \
                         {:.3} N·m stay within it",
                        joint + 1,
                        torque / damping,
                        limit * damping,
                    ),
                });
            }
        }
        doubts
    }

    /// Largest velocity of each joint by the robot's description, rad/s.
    fn speed_limits(&self) -> Vec<f64> {
        self.robot.description().per_joint(|joint| joint.velocity_rad_s)
    }
}

/// The largest value, rounded down to hundredths, so that it passes when it is taken over.
fn at_most(value: f64) -> f64 {
    (value * 100.0).floor() / 100.0
}

/// The largest torque of one component of a family.
struct LargestTorque {
    /// The field that it comes from, and its value.
    field: &'static str,
    value: String,
    torques_nm: Torques,
}

/// N·m.
enum Torques {
    OfAll(f64),
    OfEach(Vec<f64>),
}

impl Torques {
    fn of_joint(&self, joint: usize) -> Option<f64> {
        match self {
            Self::OfAll(torque) => Some(*torque),
            Self::OfEach(torques) => torques.get(joint).copied(),
        }
    }
}

impl Excitation {
    fn largest_torques(&self) -> Vec<LargestTorque> {
        let chirp = self.chirp.as_ref().map(|chirp| {
            let largest = magnitude(chirp.amplitude_nm) + magnitude(chirp.offset_nm);
            LargestTorque {
                field: "excitation.chirp.amplitude_nm",
                value: interval(chirp.amplitude_nm),
                torques_nm: Torques::OfAll(largest / chirp.torque_divisor),
            }
        });
        let multisine = self.multisine.as_ref().map(|multisine| {
            let frequency_hz = Frequency::support(&multisine.frequency_hz).max;
            let largest = magnitude(multisine.amplitude_nm_per_hz) * frequency_hz;
            let of_joint = |divisor: &f64| largest / divisor;
            LargestTorque {
                field: "excitation.multisine.amplitude_nm_per_hz",
                value: interval(multisine.amplitude_nm_per_hz),
                torques_nm: Torques::OfEach(
                    multisine.torque_divisor.iter().map(of_joint).collect(),
                ),
            }
        });
        let steps = self.steps.as_ref().map(|steps| LargestTorque {
            field: "excitation.steps.level_nm",
            value: interval(steps.level_nm),
            torques_nm: Torques::OfAll(magnitude(steps.level_nm)),
        });
        let pulses = self.pulses.as_ref().map(|pulses| LargestTorque {
            field: "excitation.pulses.level_nm",
            value: interval(pulses.level_nm),
            torques_nm: Torques::OfAll(magnitude(pulses.level_nm)),
        });
        [chirp, multisine, steps, pulses].into_iter().flatten().collect()
    }
}

fn magnitude(range: Range) -> f64 {
    range.min.abs().max(range.max.abs())
}

fn interval(range: Range) -> String {
    format!("[{}, {}]", range.min, range.max)
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::JobSpec;

    /// The warnings about a simulation with these fields.
    fn doubts(fields: &Value) -> Vec<Doubt> {
        let mut spec = json!({
            "kind": "simulate", "trajectories": 1,
            "excitation": {"chirp": {"frequency_hz": {"fixed": 0.3}}},
        });
        if let (Some(spec), Some(fields)) = (spec.as_object_mut(), fields.as_object()) {
            spec.extend(fields.clone());
        }
        match crate::parse(spec.to_string().as_bytes()) {
            Ok(JobSpec::Simulate(spec)) => spec.speed_doubts(),
            other => panic!("{other:?}"),
        }
    }

    fn check_doubts(fields: &Value, expected: &[&str]) {
        let found = doubts(fields);
        let found: Vec<&str> = found.iter().map(|doubt| doubt.field.as_str()).collect();
        assert_eq!(found, expected, "{fields}");
    }

    #[test]
    fn initial_velocities_beyond_a_joint_s_limit_are_in_doubt() {
        let initial = |fields: Value| json!({"initial_state": fields});
        check_doubts(&initial(json!({})), &[]);
        // 0.8 · 2.7 is 2.16 rad/s, and the limit of joints 2 to 4 is 2.175 rad/s.
        check_doubts(&initial(json!({"velocity_rad_s": 2.7})), &[]);
        check_doubts(&initial(json!({"velocity_rad_s": 5})), &["initial_state.velocity_rad_s"]);
        check_doubts(
            &initial(json!({"joint1_velocity_rad_s": 5, "velocity_scale": [0.2, 0.5]})),
            &["initial_state.joint1_velocity_rad_s"],
        );
        let found = doubts(&initial(json!({"velocity_rad_s": 5})));
        assert_eq!(
            found[0].to_string(),
            "initial_state.velocity_rad_s is 5: with velocity_scale up to 0.8, joint 2 starts at up \
             to 4.00 rad/s, beyond its limit of 2.175 rad/s; use at most 2.71"
        );
        check_doubts(&initial(json!({"velocity_rad_s": 2.71})), &[]);
    }

    #[test]
    fn torques_that_move_a_joint_beyond_its_limit_are_in_doubt() {
        let chirp = |amplitude: f64| {
            let chirp =
                json!({"frequency_hz": {"fixed": 0.3}, "amplitude_nm": [-amplitude, amplitude]});
            json!({"excitation": {"chirp": chirp}})
        };
        // The divisor is 2, and damping falls to 9 N·m·s/rad: 19.575 N·m hold joint 1 at 2.175 rad/s.
        check_doubts(&chirp(38.6), &[]);
        check_doubts(&chirp(50.0), &["excitation.chirp.amplitude_nm"]);
        let found = doubts(&chirp(50.0));
        assert_eq!(found[0].value, "[-50, 50]");
        assert!(found[0].reason.contains("joint 1 at up to 2.81 rad/s"), "{}", found[0].reason);
        assert!(found[0].reason.contains("19.575 N·m stay within it"), "{}", found[0].reason);

        let steps = json!({"steps": {"frequency_hz": {"fixed": 1}, "level_nm": [-30, 1]}});
        check_doubts(&json!({"excitation": steps}), &["excitation.steps.level_nm"]);
        let multisine = |f: f64| json!({"multisine": {"frequency_hz": {"fixed": f}}});
        check_doubts(&json!({"excitation": multisine(0.5)}), &[]);
        check_doubts(
            &json!({"excitation": multisine(3.0)}),
            &["excitation.multisine.amplitude_nm_per_hz"],
        );
    }

    #[test]
    fn light_damping_lets_small_torques_turn_fast_and_no_damping_says_nothing() {
        let damping = |damping: f64| json!({"robot": {"damping_nm_s_rad": vec![damping; 7]}});
        check_doubts(&damping(2.0), &[]);
        check_doubts(&damping(0.5), &["excitation.chirp.amplitude_nm"]);
        check_doubts(&damping(0.0), &[]);
    }
}

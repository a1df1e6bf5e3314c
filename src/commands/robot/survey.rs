//! A survey of the motions of an arm: how many draws a simulation would keep, and why not all.

use std::ops::{ControlFlow, Range};
use std::time::{Duration, Instant};

use dynamics::{DynamicsError, Trajectories, simulate};
use serde::Serialize;
use spec::{Rejection, SimulateSpec};

use crate::progress::ProgressCallback;

/// What the first draws of a simulation do.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Survey {
    /// Number of draws.
    pub draws: u64,
    /// Draws that stay clear of the limits.
    pub kept: u64,
    /// Draws that grow without bounds before a joint comes near a limit.
    pub diverged: u64,
    /// Draws that lose the reference of their controller, or whose controller is unstable.
    pub lost: u64,
    /// The distance from a limit at which a draw is refused, rad.
    pub margin_rad: Option<f64>,
    /// Simulated on all threads; unknown if all diverge.
    pub trajectories_per_second: Option<f64>,
    /// From the base outwards.
    pub joints: Vec<JointSurvey>,
}

/// What a joint does.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct JointSurvey {
    pub name: String,
    pub limits_deg: [f64; 2],
    pub velocity_limit_rad_s: f64,
    pub torque_limit_nm: f64,
    /// Lowest and highest position in all draws that are kept.
    pub moved_deg: Option<[f64; 2]>,
    /// The largest speed in them.
    pub fastest_rad_s: Option<f64>,
    /// The largest torque in them, with that which compensates gravity.
    pub largest_torque_nm: Option<f64>,
    /// Draws that are refused because this joint is the first that comes near a limit, or is
    /// farthest from a reference that is lost, or has the torque of an unstable controller.
    pub refused: u64,
}

/// Trajectories that are in memory at the same time.
const AT_ONCE: u64 = 1000;

impl Survey {
    /// Simulates the first draw of every trajectory of `spec`, which records velocities.
    ///
    /// # Errors
    /// `progress` asked to stop, or memory does not suffice.
    pub fn new(spec: &SimulateSpec, progress: ProgressCallback<'_>) -> Result<Self, DynamicsError> {
        let joints = spec.robot.description().joints.iter().map(|joint| JointSurvey {
            name: joint.name.clone(),
            limits_deg: [joint.position_rad.min, joint.position_rad.max].map(f64::to_degrees),
            velocity_limit_rad_s: joint.velocity_rad_s,
            torque_limit_nm: joint.torque_nm,
            moved_deg: None,
            fastest_rad_s: None,
            largest_torque_nm: None,
            refused: 0,
        });
        let mut survey = Self {
            draws: 0,
            kept: 0,
            diverged: 0,
            lost: 0,
            margin_rad: spec.rejection.position_margin_rad,
            trajectories_per_second: None,
            joints: joints.collect(),
        };
        // Without rejection, a draw goes on beyond the limits and shows which joint is first.
        let rejection = Rejection { position_margin_rad: None, max_draws: 1 };
        let unlimited = SimulateSpec { rejection, ..spec.clone() };
        let mut time = Duration::ZERO;
        let mut timed = 0;
        let starts = (0..spec.trajectories.div_ceil(AT_ONCE)).map(|chunk| chunk * AT_ONCE);
        let chunks = starts.map(|start| start..spec.trajectories.min(start + AT_ONCE));
        let mut ranges: Vec<Range<u64>> = chunks.rev().collect();
        while let Some(Range { start, end }) = ranges.pop() {
            let done = survey.draws;
            // A draw that diverges reports no progress.
            if progress(done).is_break() {
                return Err(DynamicsError::Cancelled { range: start..end });
            }
            let begin = Instant::now();
            match simulate(&unlimited, start..end, &|finished| progress(done + finished)) {
                Ok(trajectories) => {
                    time += begin.elapsed();
                    timed += end - start;
                    survey.add(&trajectories);
                }
                Err(DynamicsError::NotFinite { sample, .. }) if end - start == 1 => {
                    survey.add_diverging(&unlimited, start, sample)?;
                }
                Err(DynamicsError::NoDrawTracked { joint, .. }) if end - start == 1 => {
                    survey.draws += 1;
                    survey.lost += 1;
                    survey.joints[joint - 1].refused += 1;
                }
                // One of them diverges, or is lost. Halves of halves find it.
                Err(DynamicsError::NotFinite { .. } | DynamicsError::NoDrawTracked { .. }) => {
                    let middle = start + (end - start) / 2;
                    ranges.extend([middle..end, start..middle]);
                }
                Err(error) => return Err(error),
            }
        }
        if timed > 0 {
            survey.trajectories_per_second = Some(timed as f64 / time.as_secs_f64().max(1e-9));
        }
        Ok(survey)
    }

    /// Adds draws that end without diverging.
    fn add(&mut self, trajectories: &Trajectories) {
        let count = self.joints.len();
        let row_len = trajectories.series.samples() * count;
        let rows = |values: &[f32], row: usize| values[row * row_len..][..row_len].to_vec();
        for row in 0..trajectories.series.robots() {
            self.draws += 1;
            let q = rows(trajectories.series.true_y(), row);
            if let Some(joint) = self.first_near_a_limit(&q) {
                self.joints[joint].refused += 1;
                continue;
            }
            self.kept += 1;
            let u = rows(trajectories.series.true_u(), row);
            let qd = trajectories.qd.as_ref().map(|qd| rows(qd, row)).unwrap_or_default();
            for (index, joint) in self.joints.iter_mut().enumerate() {
                let of_joint = |values: &[f32]| -> Vec<f64> {
                    values.iter().skip(index).step_by(count).copied().map(f64::from).collect()
                };
                let largest = |values: &[f32], before: Option<f64>| {
                    of_joint(values).into_iter().map(f64::abs).chain(before).reduce(f64::max)
                };
                let angles = of_joint(&q).into_iter().map(f64::to_degrees);
                for angle in angles {
                    let [low, high] = joint.moved_deg.unwrap_or([angle; 2]);
                    joint.moved_deg = Some([low.min(angle), high.max(angle)]);
                }
                joint.fastest_rad_s = largest(&qd, joint.fastest_rad_s);
                joint.largest_torque_nm = largest(&u, joint.largest_torque_nm);
            }
        }
    }

    /// Adds the draw of trajectory `index`, whose positions are finite before `sample`. It counts as
    /// diverged if no joint comes near a limit until then.
    fn add_diverging(
        &mut self,
        spec: &SimulateSpec,
        index: u64,
        sample: usize,
    ) -> Result<(), DynamicsError> {
        let samples = u32::try_from(sample).unwrap_or(spec.samples);
        let mut refusing = None;
        if samples > 0 {
            let until = SimulateSpec { samples, ..spec.clone() };
            let beginning = simulate(&until, index..index + 1, &|_| ControlFlow::Continue(()))?;
            refusing = self.first_near_a_limit(beginning.series.true_y());
        }
        self.draws += 1;
        match refusing {
            Some(joint) => self.joints[joint].refused += 1,
            None => self.diverged += 1,
        }
        Ok(())
    }

    /// The joint that is farthest beyond its margin at the first sample at which one is; `q` is
    /// [sample, joint] in rad.
    fn first_near_a_limit(&self, q: &[f32]) -> Option<usize> {
        let margin = self.margin_rad?;
        let excess = |(joint, q): (&JointSurvey, &f32)| {
            let [low, high] = joint.limits_deg.map(f64::to_radians);
            (low - f64::from(*q)).max(f64::from(*q) - high) + margin
        };
        q.chunks_exact(self.joints.len()).find_map(|sample| {
            let beyond = self.joints.iter().zip(sample).map(excess).enumerate();
            let farthest = beyond.max_by(|(_, a), (_, b)| a.total_cmp(b));
            farthest.filter(|(_, excess)| *excess > 0.0).map(|(joint, _)| joint)
        })
    }
}

#[cfg(test)]
mod tests {
    use spec::{JobSpec, RobotModel};

    use super::*;

    fn spec(robot: &serde_json::Value, amplitude_nm: f64) -> SimulateSpec {
        let spec = serde_json::json!({
            "kind": "simulate", "trajectories": 24, "samples": 60,
            "excitation": {"chirp": {
                "frequency_hz": {"fixed": 0.3}, "amplitude_nm": [-amplitude_nm, amplitude_nm],
            }},
            "robot": robot,
            "observations": {"joint_velocities": true},
        });
        match spec::parse_json(spec).unwrap() {
            JobSpec::Simulate(spec) => spec,
            other => panic!("{}", other.kind()),
        }
    }

    fn survey(spec: &SimulateSpec) -> Survey {
        Survey::new(spec, &|_| ControlFlow::Continue(())).unwrap()
    }

    #[test]
    fn as_many_first_draws_are_kept_as_a_simulation_accepts() {
        let spec = spec(&serde_json::json!({}), 60.0);
        let found = survey(&spec);
        let trajectories = simulate(&spec, 0..24, &|_| ControlFlow::Continue(())).unwrap();
        let first = trajectories.scenarios.iter().filter(|scenario| scenario.draws == 1).count();
        assert_eq!(found.kept, first as u64);
        assert!((1..24).contains(&found.kept), "{found:?}");
        let refused: u64 = found.joints.iter().map(|joint| joint.refused).sum();
        assert_eq!(found.draws, found.kept + found.diverged + refused);
        assert!(found.trajectories_per_second > Some(0.0));
        for joint in &found.joints {
            let ([low, high], [from, to]) = (joint.limits_deg, joint.moved_deg.unwrap());
            assert!(low < from && from < to && to < high, "{joint:?}");
            assert!(joint.fastest_rad_s > Some(0.0) && joint.largest_torque_nm > Some(0.0));
        }
    }

    #[test]
    fn draws_that_diverge_are_counted_and_do_not_hide_the_others() {
        // Without damping, and with inertias that explicit steps cannot follow.
        let mut description = RobotModel::panda().description().clone();
        for joint in &mut description.joints {
            joint.position_rad = spec::Range::new(-100.0, 100.0);
            joint.damping_nm_s_rad = 1000.0;
            joint.link.mass_kg *= 1e-3;
            joint.link.inertia_kg_m2 = joint.link.inertia_kg_m2.map(|entry| 1e-3 * entry);
        }
        description.hand.bodies.clear();
        let mut spec = spec(&serde_json::json!({"model": description}), 1.0);
        spec.integrator = spec::Integrator::Rk4 { substeps: 1 };
        let found = survey(&spec);
        assert_eq!(found.draws, 24);
        assert!(found.diverged > 0, "{found:?}");
        let cancelled = Survey::new(&spec, &|_| ControlFlow::Break(()));
        assert!(matches!(cancelled, Err(DynamicsError::Cancelled { .. })), "{cancelled:?}");
    }
}

//! How well a robot followed its path.

use std::ops::ControlFlow;

use dynamics::{DynamicsError, Joints, Scenarios};
use serde::{Deserialize, Serialize};
use spec::{Range, SimulateSpec};

use super::trial::{Trace, rms};

/// How well a robot followed its path, and with which torques.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tracking {
    /// Mean over joints of `joint_rms_deg`.
    pub rms_deg: f64,
    /// Root mean square over time.
    pub joint_rms_deg: Vec<f64>,
    /// The largest error of any joint.
    pub peak_deg: f64,
    /// Root mean square over time and joints.
    pub torque_rms_nm: f64,
    /// Share of torques above the 99th percentile of the same joint's torques in the excitation.
    pub beyond_excitation: f64,
    /// Least distance of a joint to one of its limits, rad. It is negative beyond a limit, since
    /// the simulated arm has no stops.
    pub clearance_rad: f64,
}

/// Measures how robots of a simulation follow their paths.
#[derive(Clone, Debug)]
pub(super) struct Judge {
    joints: usize,
    limits_rad: Vec<Range>,
    /// For each joint, the 99th percentile of the absolute torques before control, N·m.
    excited_nm: Joints<f64>,
}

impl Judge {
    pub fn new(simulation: &SimulateSpec, excited_nm: Joints<f64>) -> Self {
        let limits_rad = simulation.robot.description().per_joint(|joint| joint.position_rad);
        Self { joints: simulation.joints(), limits_rad, excited_nm }
    }

    pub fn limits_rad(&self) -> &[Range] {
        &self.limits_rad
    }

    pub fn tracking(&self, trace: &Trace) -> Tracking {
        let errors: Vec<Joints<f64>> = trace.errors().collect();
        let joint_rms_deg = (0..self.joints).map(|joint| {
            let of_joint: Vec<f64> = errors.iter().map(|errors| errors[joint]).collect();
            rms(&of_joint).to_degrees()
        });
        let joint_rms_deg: Vec<f64> = joint_rms_deg.collect();
        let torques: Vec<f64> = trace.torques.iter().flatten().map(|&u| u.into()).collect();
        let beyond = trace.torques.iter().flat_map(|torques| torques.iter().zip(&self.excited_nm));
        let beyond = beyond.filter(|(u, excited)| f64::from(u.abs()) > **excited).count();
        let clearance = trace.positions.iter().flat_map(|positions| {
            positions.iter().zip(&self.limits_rad).map(|(&q, limits)| {
                let q = f64::from(q);
                (q - limits.min).min(limits.max - q)
            })
        });
        Tracking {
            rms_deg: joint_rms_deg.iter().sum::<f64>() / self.joints as f64,
            joint_rms_deg,
            peak_deg: errors.iter().flatten().map(|e| e.abs()).fold(0.0, f64::max).to_degrees(),
            torque_rms_nm: rms(&torques),
            beyond_excitation: beyond as f64 / torques.len() as f64,
            clearance_rad: clearance.fold(f64::INFINITY, f64::min),
        }
    }
}

/// For each joint, the 99th percentile of an excitation's absolute torques, N·m.
pub(super) fn excited_nm(simulation: &SimulateSpec) -> Joints<f64> {
    /// Number of simulated trajectories. One joint then has 25 600 torques, of which 1 % are above
    /// the percentile.
    const TRAJECTORIES: u64 = 256;
    const TIMES: u32 = 100;
    let scenarios = Scenarios::new(simulation);
    let duration_s = f64::from(simulation.samples) / simulation.rate_hz;
    let mut torques: Vec<Joints<f64>> = Vec::new();
    for index in 0..TRAJECTORIES {
        let excitation = scenarios.draw(index, 1).excitation;
        let Some(law) = excitation.torques() else { continue };
        torques.extend((0..TIMES).map(|k| law.at(duration_s * f64::from(k) / f64::from(TIMES))));
    }
    largest_of_99_percent(simulation.joints(), &torques)
}

/// For each joint, the 99th percentile of the absolute torques that controllers give, N·m.
///
/// # Errors
/// Those of [`dynamics::simulate`].
pub(super) fn commanded_nm(simulation: &SimulateSpec) -> Result<Joints<f64>, DynamicsError> {
    /// Number of simulated trajectories, if the simulation has as many.
    const TRAJECTORIES: u64 = 32;
    let count = TRAJECTORIES.min(simulation.trajectories);
    let simulated = dynamics::simulate(simulation, 0..count, &|_| ControlFlow::Continue(()))?;
    let joints = simulation.joints();
    let torques: Vec<Joints<f64>> = simulated
        .series
        .true_u()
        .chunks_exact(joints)
        .map(|torques| torques.iter().map(|torque| f64::from(*torque)).collect())
        .collect();
    Ok(largest_of_99_percent(joints, &torques))
}

/// The 99th percentile of absolute torques, N·m. There is at least one.
fn largest_of_99_percent(joints: usize, torques: &[Joints<f64>]) -> Joints<f64> {
    Joints::from_fn(joints, |joint| {
        let mut sizes: Vec<f64> = torques.iter().map(|torques| torques[joint].abs()).collect();
        let position = sizes.len() * 99 / 100;
        *sizes.select_nth_unstable_by(position, f64::total_cmp).1
    })
}

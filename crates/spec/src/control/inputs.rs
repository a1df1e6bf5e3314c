//! Checks that a closed loop fits its data and its checkpoints.

use super::path::{ControlPath, Swing};
use super::planner::{Planner, usual_noise_nm};
use super::{ControlBaseline, ControlSpec};
use crate::check::Violations;
use crate::{
    DataSpec, Given, Gravity, Normalization, RobotDescription, RobotModel, SimulateSpec, SpecError,
    Training,
};

/// The largest number of control steps of one robot.
const MAX_STEPS: f64 = 100_000.0;

impl ControlSpec {
    /// Compares the spec with the data and the trainings that its references were resolved to.
    ///
    /// # Errors
    /// Names each field that does not fit `data` or a training, with both numbers.
    pub fn check_inputs(
        &self,
        data: &DataSpec,
        trainings: &[Training<'_>],
    ) -> Result<(), SpecError> {
        let Some(simulation) = data.simulation() else {
            return Err(SpecError::one(
                "data",
                "recordings",
                "a simulation, whose robots can move",
            ));
        };
        let mut violations = Violations::default();
        if u64::from(self.robots) > simulation.trajectories {
            let allowed = format!("at most the data's trajectories, {}", simulation.trajectories);
            violations.add("robots", self.robots, allowed);
        }
        if self.context > simulation.samples {
            let allowed = format!("at most the data's samples, which are {}", simulation.samples);
            violations.add("context", self.context, allowed);
        }
        let steps = self.duration_s * simulation.rate_hz;
        if !(0.5..=MAX_STEPS).contains(&steps) {
            let allowed = format!("1 to {MAX_STEPS} samples at {} Hz", simulation.rate_hz);
            violations.add("duration_s", self.duration_s, allowed);
        }
        match simulation.controller {
            Some(_) => self.check_added_torques(simulation, &mut violations),
            None => self.check_plans(simulation, &mut violations),
        }
        for (i, training) in trainings.iter().enumerate() {
            let field = format!("checkpoints[{i}]");
            let joints = training.data.joints();
            if joints != simulation.joints() {
                let asked = format!("{} joints, as the data's robots have", simulation.joints());
                violations.add(&field, format!("trained with {joints} joints"), asked);
            }
            if training.spec.given != Given::Torques {
                let allowed = "one that is given torques, which are chosen here";
                violations.add(&field, "trained with given references", allowed);
            }
            match simulation.controller {
                Some(_) => check_says_torques(&field, simulation, training, &mut violations),
                None => self.check_plans_with(&field, simulation, training, &mut violations),
            }
        }
        violations.finish()
    }

    /// Checks that the planner can move robots.
    fn check_plans(&self, simulation: &SimulateSpec, violations: &mut Violations) {
        let robot = simulation.robot.description();
        self.path.check_robot(robot, violations);
        violations.one_per_joint("planner.noise_nm", &self.planner.noise_nm, robot.joints.len());
        let strongest = robot.joints.iter().map(|joint| joint.torque_nm).fold(0.0, f64::max);
        for (i, noise) in self.planner.noise_nm.iter().enumerate() {
            if *noise > strongest {
                let allowed = format!("at most {strongest}, the largest torque of any joint");
                violations.add(&format!("planner.noise_nm[{i}]"), noise, allowed);
            }
        }
        if simulation.robot.gravity == Gravity::Compensated {
            let allowed = "off or on: a plan holds all torques that act";
            violations.add("data.robot.gravity", "compensated", allowed);
        }
        let identification = ControlBaseline::Identification;
        if let Some(i) = self.baselines.iter().position(|name| *name == identification) {
            let allowed = "left out: it does not plan, and the data's robots have no controller";
            violations.add(&format!("baselines[{i}]"), "\"identification\"", allowed);
        }
    }

    /// Checks that the robots' own controllers can go on along their references.
    fn check_added_torques(&self, simulation: &SimulateSpec, violations: &mut Violations) {
        let robot = simulation.robot.description();
        let mut usual = (ControlPath::default(), Planner::default());
        fit_to_robot(&mut usual.0, &mut usual.1, robot);
        if self.path != usual.0 {
            let allowed = "left out: the data's robots follow the references of their controllers";
            violations.add("path", "given", allowed);
        }
        if self.planner != usual.1 {
            let allowed = "left out: the data's robots have controllers of their own";
            violations.add("planner", "given", allowed);
        }
        let steps = u64::from(self.steps(simulation.rate_hz));
        let left = u64::from(simulation.samples.saturating_sub(self.context));
        if steps > left {
            let allowed = format!(
                "at most {} s: the data has {} samples at {} Hz, and {} of them come before control",
                left as f64 / simulation.rate_hz,
                simulation.samples,
                simulation.rate_hz,
                self.context,
            );
            violations.add("duration_s", self.duration_s, allowed);
        }
    }

    /// Checks that a checkpoint can plan.
    fn check_plans_with(
        &self,
        field: &str,
        simulation: &SimulateSpec,
        training: &Training<'_>,
        violations: &mut Violations,
    ) {
        let context = training.spec.context;
        if context != self.context {
            let asked = format!("context {}, as this job asks", self.context);
            violations.add(field, format!("trained with context {context}"), asked);
        }
        let rate_hz = training.data.rate_hz();
        if (rate_hz - simulation.rate_hz).abs() > f64::EPSILON {
            let asked = format!("rate_hz {}, as the data has", simulation.rate_hz);
            violations.add(field, format!("trained with rate_hz {rate_hz}"), asked);
        }
        let foreseen = training.data.samples().saturating_sub(context);
        if self.planner.horizon > foreseen {
            let allowed = format!("at most {foreseen}, the horizon of {field}");
            violations.add("planner.horizon", self.planner.horizon, allowed);
        }
        if training.spec.normalization == Normalization::PaperLeaky {
            let allowed = "one that does not need the future that it predicts";
            violations.add(field, "trained with normalization paper-leaky", allowed);
        }
    }
}

/// Checks that a checkpoint can say the torques of a motion.
fn check_says_torques(
    field: &str,
    simulation: &SimulateSpec,
    training: &Training<'_>,
    violations: &mut Violations,
) {
    let model = &training.spec.model;
    if !model.is_physical() {
        let allowed = "one with equations of motion, which say the torques of a motion: lagrangian";
        violations.add(field, model.architecture(), allowed);
    }
    let (trained, asked) = (training.data.rate_hz(), simulation.rate_hz);
    if model.multiple(trained, asked).is_none() {
        let allowed = format!("rate_hz {asked}, as the data has, or a whole part of it");
        violations.add(field, format!("trained with rate_hz {trained}"), allowed);
    }
}

/// Replaces default lists, which are for the Panda, if `robot` has another number of joints.
pub(super) fn fit_to_robot(
    path: &mut ControlPath,
    planner: &mut Planner,
    robot: &RobotDescription,
) {
    if robot.joints.len() == RobotModel::panda().description().joints.len() {
        return;
    }
    let fitting = Swing::of(robot);
    if let ControlPath::Swing(swing) = path {
        let usual = Swing::default();
        replace_usual(&mut swing.amplitude_rad, &usual.amplitude_rad, fitting.amplitude_rad);
        replace_usual(&mut swing.frequency_hz, &usual.frequency_hz, fitting.frequency_hz);
    }
    replace_usual(&mut planner.noise_nm, &Planner::default().noise_nm, usual_noise_nm(robot));
}

fn replace_usual(list: &mut Vec<f64>, usual: &[f64], fitting: Vec<f64>) {
    if list == usual {
        *list = fitting;
    }
}

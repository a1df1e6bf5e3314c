use serde::{Deserialize, Serialize};
use spec::{ControlSpec, SpecError};
use store::{NewTask, Output};

use crate::inputs::Inputs;
use crate::kind::{Kind, task};

/// The payload of a task in the closed loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ControlTask {
    /// The robot of this trajectory, controlled by every controller in turn.
    Robot(u32),
    /// The report on all robots.
    Report,
}

impl Kind for ControlSpec {
    fn unit(&self) -> &'static str {
        "samples"
    }

    fn tasks(&self, inputs: &Inputs) -> Result<Vec<NewTask>, SpecError> {
        let controllers = (self.baselines.len() + self.checkpoints.len()) as u64;
        let samples = controllers * u64::from(self.steps(inputs.data()?.spec.rate_hz()));
        let robots = (0..self.robots).map(|robot| {
            task(0, robot, format!("robot {robot:02}"), &ControlTask::Robot(robot), samples)
        });
        Ok(robots.chain([task(1, 0, "report", &ControlTask::Report, 0)]).collect())
    }

    fn output(&self) -> Output {
        Output::Run
    }

    fn check_inputs(&self, inputs: &Inputs) -> Result<(), SpecError> {
        Self::check_inputs(self, &inputs.data()?.spec, &inputs.trainings())
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use crate::inputs::tests::{inputs_of, parse};
    use crate::kind::kind;

    #[test]
    fn a_closed_loop_has_a_task_per_robot_that_counts_every_controllers_samples() {
        let inputs = inputs_of(&parse(&json!({"preset": "D1-chirp"})));
        let spec = json!({
            "kind": "control", "data": {"digest": "0".repeat(64)},
            "robots": 3, "duration_s": 2.0, "baselines": ["zero-torque", "oracle"],
        });
        let tasks = kind(&parse(&spec)).unwrap().tasks(&inputs).unwrap();
        let found: Vec<_> = tasks.iter().map(|task| (task.payload.clone(), task.total)).collect();
        let robot = |robot: u32| (json!({"robot": robot}), 2 * 120);
        assert_eq!(found, [robot(0), robot(1), robot(2), (json!("report"), 0)]);
    }
}

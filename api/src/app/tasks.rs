//! The pieces of a job that workers lease.

use serde_json::{Value, json};
use spec::{ControlSpec, DataSpec, EvaluateSpec, JobSpec, SimulateSpec, SpecError};
use store::{DatasetId, NewTask};

use crate::limits::TASKS_PER_JOB;

/// The tasks of a job and what their progress counts.
#[derive(Clone, Debug)]
pub struct Plan {
    pub unit: &'static str,
    pub tasks: Vec<NewTask>,
}

impl Plan {
    /// The tasks of `spec`, which reads `data` if it reads trajectories, and verifies `dataset` if
    /// that exists already.
    ///
    /// # Errors
    /// When there would be more than [`TASKS_PER_JOB`], or data that is needed is missing.
    pub fn new(
        spec: &JobSpec,
        data: Option<&DataSpec>,
        dataset: Option<DatasetId>,
    ) -> Result<Self, SpecError> {
        match (spec, data) {
            (JobSpec::Simulate(spec), _) => Self::of_simulation(spec),
            (JobSpec::Train(spec), _) => {
                let task = task(0, 0, "train".to_owned(), json!({}), spec.steps);
                Ok(Self { unit: "steps", tasks: vec![task] })
            }
            (JobSpec::Evaluate(spec), Some(data)) => Ok(Self::of_evaluation(spec, data)),
            (JobSpec::Control(spec), Some(data)) => Ok(Self::of_control(spec, data)),
            (JobSpec::Import(_), _) => {
                let task = task(0, 0, "import".to_owned(), json!({}), 0);
                Ok(Self { unit: "trajectories", tasks: vec![task] })
            }
            (JobSpec::Verify(_), Some(data)) => Ok(Self::of_verification(data, dataset)),
            (JobSpec::Evaluate(_) | JobSpec::Control(_) | JobSpec::Verify(_), None) => {
                Err(SpecError::one("data", "", "a dataset"))
            }
            (JobSpec::Pipeline(_), _) => {
                Err(SpecError::one("kind", "pipeline", "any other kind of job"))
            }
        }
    }

    /// One task per shard.
    fn of_simulation(spec: &SimulateSpec) -> Result<Self, SpecError> {
        let shards = u32::try_from(spec.shard_count()).unwrap_or(u32::MAX);
        if shards > TASKS_PER_JOB {
            return Err(SpecError::one(
                "shard_trajectories",
                spec.shard_trajectories.to_string(),
                format!("so many that at most {TASKS_PER_JOB} shards are needed, not {shards}"),
            ));
        }
        let shard = |shard: u32| {
            let trajectories = spec.shard(u64::from(shard));
            let total = trajectories.end - trajectories.start;
            task(0, shard, format!("shard {shard:05}"), json!({"shard": shard}), total)
        };
        Ok(Self { unit: "trajectories", tasks: (0..shards).map(shard).collect() })
    }

    /// One task per shard, which names the dataset: others may have the same digest.
    fn of_verification(data: &DataSpec, dataset: Option<DatasetId>) -> Self {
        let shards = u32::try_from(data.shard_count()).unwrap_or(u32::MAX);
        let task = |shard: u32| {
            let total = data.simulation().map_or(0, |spec| {
                let trajectories = spec.shard(u64::from(shard));
                trajectories.end - trajectories.start
            });
            let mut payload = json!({"shard": shard});
            if let Some(dataset) = dataset {
                payload["dataset"] = dataset.0.into();
            }
            task(0, shard, format!("shard {shard:05}"), payload, total)
        };
        Self { unit: "trajectories", tasks: (0..shards).map(task).collect() }
    }

    /// One task per cell; when no other of them runs, one that measures latencies, if it is asked for;
    /// and the report over all of them.
    fn of_evaluation(spec: &EvaluateSpec, data: &DataSpec) -> Self {
        let cells = spec.cells(data);
        let mut tasks: Vec<NewTask> = (0u32..)
            .zip(cells)
            .map(|(k, cell)| task(0, k, cell.to_string(), json!({"cell": k}), cell.count))
            .collect();
        let report = if spec.latency.is_some() {
            tasks.push(task(1, 0, "latency".to_owned(), json!({"latency": true}), 0));
            2
        } else {
            1
        };
        tasks.push(task(report, 0, "report".to_owned(), json!({}), 0));
        Self { unit: "scenarios", tasks }
    }

    /// One task per robot, in which every controller has it, and the report over all of them.
    fn of_control(spec: &ControlSpec, data: &DataSpec) -> Self {
        let controllers = (spec.baselines.len() + spec.checkpoints.len()) as u64;
        let samples = controllers * u64::from(spec.steps(data.rate_hz()));
        let robots = (0..spec.robots).map(|robot| {
            task(0, robot, format!("robot {robot:02}"), json!({"robot": robot}), samples)
        });
        let report = task(1, 0, "report".to_owned(), json!({}), 0);
        Self { unit: "samples", tasks: robots.chain([report]).collect() }
    }
}

fn task(stage: u32, ordinal: u32, label: String, payload: Value, total: u64) -> NewTask {
    NewTask { stage, ordinal, label, payload, total }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(spec: &Value) -> JobSpec {
        spec::parse(spec.to_string().as_bytes()).unwrap()
    }

    #[test]
    fn a_simulation_has_a_task_per_shard_and_the_last_one_is_shorter() {
        let spec = json!({"preset": "D1-chirp", "trajectories": 25, "shard_trajectories": 10});
        let plan = Plan::new(&parse(&spec), None, None).unwrap();
        let tasks: Vec<_> = plan.tasks.iter().map(|it| (it.label.as_str(), it.total)).collect();
        assert_eq!(tasks, [("shard 00000", 10), ("shard 00001", 10), ("shard 00002", 5)]);
        assert_eq!(plan.tasks[2].payload, json!({"shard": 2}));
    }

    #[test]
    fn a_simulation_in_tiny_shards_is_refused() {
        let spec = json!({"preset": "D1-chirp", "shard_trajectories": 1});
        let error = Plan::new(&parse(&spec), None, None).unwrap_err();
        assert_eq!(error.violations[0].field, "shard_trajectories");
    }

    #[test]
    fn a_verification_has_a_task_per_shard_that_names_the_dataset() {
        let spec = json!({"preset": "D1-chirp", "trajectories": 25, "shard_trajectories": 10});
        let JobSpec::Simulate(data) = parse(&spec) else { panic!("not a simulation") };
        let spec = json!({"kind": "verify", "data": {"dataset": 3}});
        let data = DataSpec::Simulation(data);
        let plan = Plan::new(&parse(&spec), Some(&data), Some(DatasetId(3))).unwrap();
        assert_eq!(plan.tasks.iter().map(|task| task.total).collect::<Vec<_>>(), [10, 10, 5]);
        assert_eq!(plan.tasks[2].payload, json!({"shard": 2, "dataset": 3}));
    }

    #[test]
    fn an_evaluation_has_a_task_per_cell_and_a_report_after_them() {
        let JobSpec::Simulate(data) = parse(&json!({"preset": "grid-chirp"})) else {
            panic!("not a simulation");
        };
        let digest = "0".repeat(64);
        let spec = json!({"kind": "evaluate", "data": {"digest": digest}});
        let plan = Plan::new(&parse(&spec), Some(&DataSpec::Simulation(data)), None).unwrap();
        assert_eq!(plan.tasks.len(), 11);
        assert_eq!((plan.tasks[2].label.as_str(), plan.tasks[2].total), ("chirp 0.3 Hz", 100));
        assert_eq!((plan.tasks[10].stage, plan.tasks[10].label.as_str()), (1, "report"));
    }
}

use serde::{Deserialize, Serialize};
use spec::{SimulateSpec, SpecError};
use store::{JobReuse, NewTask, Output, PartReuse};

use crate::inputs::Inputs;
use crate::kind::Limits;
use crate::kind::{Kind, TASKS_PER_JOB, task};

/// The payload of a task: one shard.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct ShardTask {
    /// The index of the shard, from 0.
    pub shard: u32,
}

impl Kind for SimulateSpec {
    fn unit(&self) -> &'static str {
        "trajectories"
    }

    fn tasks(&self, _inputs: &Inputs) -> Result<Vec<NewTask>, SpecError> {
        let shards = u32::try_from(self.shard_count()).unwrap_or(u32::MAX);
        if shards > TASKS_PER_JOB {
            return Err(SpecError::one(
                "shard_trajectories",
                self.shard_trajectories.to_string(),
                format!("a larger value: {TASKS_PER_JOB} shards are allowed, this needs {shards}"),
            ));
        }
        let shard = |shard: u32| {
            let trajectories = self.shard(u64::from(shard));
            let total = trajectories.end - trajectories.start;
            task(0, shard, format!("shard {shard:05}"), &ShardTask { shard }, total)
        };
        Ok((0..shards).map(shard).collect())
    }

    /// Shards can be copied from an earlier job.
    fn reuse(&self) -> JobReuse {
        JobReuse { whole: true, parts: PartReuse::Objects }
    }

    fn output(&self) -> Output {
        Output::Dataset { trajectories: self.trajectories, samples: self.samples }
    }

    /// A stream is not stored, so it may have any size.
    fn check_limits(&self, limits: &Limits) -> Result<(), SpecError> {
        if self.trajectories <= limits.max_trajectories {
            return Ok(());
        }
        let allowed = format!(
            "at most {}, the limit that this server was started with (--max-trajectories)",
            limits.max_trajectories
        );
        Err(SpecError::one("trajectories", self.trajectories.to_string(), allowed))
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::inputs::tests::parse;

    fn tasks(shard_trajectories: u32) -> Result<Vec<NewTask>, SpecError> {
        let spec = json!({
            "preset": "D1-chirp",
            "trajectories": 25_000,
            "shard_trajectories": shard_trajectories,
        });
        crate::kind::kind(&parse(&spec)).unwrap().tasks(&Inputs::default())
    }

    #[test]
    fn a_simulation_has_a_task_per_shard_and_the_last_one_is_shorter() {
        let tasks = tasks(10_000).unwrap();
        let labels: Vec<_> = tasks.iter().map(|task| (task.label.as_str(), task.total)).collect();
        let expected = [("shard 00000", 10_000), ("shard 00001", 10_000), ("shard 00002", 5_000)];
        assert_eq!(labels, expected);
        assert_eq!(tasks[2].payload, json!({"shard": 2}));
    }

    #[test]
    fn a_simulation_in_tiny_shards_is_refused() {
        let error = tasks(1).unwrap_err();
        assert_eq!(error.violations[0].field, "shard_trajectories");
    }
}

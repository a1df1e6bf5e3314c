//! The trait of job kinds, which each kind's module implements.

use std::collections::HashMap;

use serde::Serialize;
use spec::{DataSpec, Doubt, JobKind, JobSpec, SpecError, TrainSpec};
use store::{JobReuse, Need, NewTask, Output, PartReuse};

use crate::inputs::Inputs;

/// The largest number of tasks of a job. A job with more is refused with a violation that names the
/// field.
pub(crate) const TASKS_PER_JOB: u32 = 10_000;

/// The largest number of tasks of all jobs of a pipeline. Inserting them holds the write lock of
/// the database, and leases wait for it.
pub(crate) const TASKS_PER_SUBMISSION: usize = 50_000;

/// Why a training on some data may not fit into the machine's memory.
///
/// The code that computes models is not compiled into this crate. The server's composition passes
/// the function in.
pub type MemoryDoubts = dyn Fn(&TrainSpec, &DataSpec) -> Option<Doubt> + Send + Sync;

/// The limits of a server on requests.
#[derive(Clone, Debug)]
pub struct Limits {
    /// Largest number of trajectories of a simulation.
    pub max_trajectories: u64,
    /// The time limit of an attempt at a task in seconds, for the kinds that have one. Jobs without
    /// a limit of their own get it.
    pub time_limits_s: HashMap<JobKind, u32>,
}

/// A spec of one kind, as a job. The smallest one is in the tests below.
pub(crate) trait Kind {
    /// The unit of the job's progress.
    fn unit(&self) -> &'static str;

    /// The tasks that workers lease.
    ///
    /// # Errors
    /// When there would be more than [`TASKS_PER_JOB`], or needed data is missing.
    fn tasks(&self, inputs: &Inputs) -> Result<Vec<NewTask>, SpecError>;

    /// The record that the job fills: a dataset, a run, or nothing.
    fn output(&self) -> Output;

    /// How far the job can use earlier work with the same digest.
    fn reuse(&self) -> JobReuse {
        JobReuse { whole: true, parts: PartReuse::Nothing }
    }

    /// Compares the spec with the work that it refers to.
    ///
    /// # Errors
    /// Names each field that does not fit the data that the spec refers to.
    fn check_inputs(&self, _inputs: &Inputs) -> Result<(), SpecError> {
        Ok(())
    }

    /// Compares the spec with the limits of the server.
    ///
    /// # Errors
    /// Names each field that exceeds a limit of the server.
    fn check_limits(&self, _limits: &Limits) -> Result<(), SpecError> {
        Ok(())
    }

    /// Jobs that must succeed first.
    fn needs(&self, inputs: &Inputs) -> Vec<Need> {
        inputs.needs.clone()
    }

    /// The job's name outside a pipeline. `None` stands for its kind with the beginning of its
    /// digest.
    fn name(&self, _inputs: &Inputs) -> Option<String> {
        None
    }

    /// Why the job may not fit into memory with its `data`.
    fn memory_doubt(&self, _data: &DataSpec, _memory: &MemoryDoubts) -> Option<Doubt> {
        None
    }
}

macro_rules! registered {
    ($($name:ident => $Kind:ident($Spec:ident),)*) => {
        /// The kind of a job; `None` for a pipeline, which has jobs instead of tasks.
        pub(crate) fn kind(spec: &JobSpec) -> Option<&dyn Kind> {
            match spec {
                $(JobSpec::$Kind(spec) => Some(spec),)*
                JobSpec::Pipeline(_) => None,
            }
        }
    };
}

spec::for_each_kind!(registered);

/// The task at `ordinal` of its stage, with `total` units of work.
pub(crate) fn task(
    stage: u32,
    ordinal: u32,
    label: impl Into<String>,
    payload: &impl Serialize,
    total: u64,
) -> NewTask {
    // The payloads are plain numbers and names, so this cannot fail.
    let payload = serde_json::to_value(payload).expect("a payload serializes to JSON");
    NewTask { stage, ordinal, label: label.into(), payload, total }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A job that counts to a number, in one task.
    struct Count {
        to: u64,
    }

    #[derive(Serialize)]
    struct CountTask {
        to: u64,
    }

    impl Kind for Count {
        fn unit(&self) -> &'static str {
            "numbers"
        }

        fn tasks(&self, _: &Inputs) -> Result<Vec<NewTask>, SpecError> {
            Ok(vec![task(0, 0, "count", &CountTask { to: self.to }, self.to)])
        }

        fn output(&self) -> Output {
            Output::Nothing
        }
    }

    #[test]
    fn a_kind_says_its_tasks_its_unit_and_its_output() {
        let count = Count { to: 3 };
        let tasks = count.tasks(&Inputs::default()).unwrap();
        assert_eq!((tasks.len(), tasks[0].total, count.unit()), (1, 3, "numbers"));
        assert_eq!(tasks[0].payload, serde_json::json!({"to": 3}));
        assert!(count.reuse().whole && count.needs(&Inputs::default()).is_empty());
    }
}

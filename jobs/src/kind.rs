//! The trait that the module of every kind implements.

use std::collections::HashMap;

use serde::Serialize;
use spec::{DataSpec, Doubt, JobKind, JobSpec, SpecError, TrainSpec};
use store::{JobReuse, Need, NewTask, Output, PartReuse};

use crate::inputs::Inputs;

/// Tasks of one job. Crossing it is a violation of the field that asks for so many.
pub(crate) const TASKS_PER_JOB: u32 = 10_000;

/// Tasks of all jobs of a pipeline. Inserting them takes the write lock of the database, for which leases wait.
pub(crate) const TASKS_PER_SUBMISSION: usize = 50_000;

/// Why a training on data may not fit into the machine's memory.
///
/// Nothing that computes models is compiled for this crate; whoever composes the server brings it.
pub type MemoryDoubts = dyn Fn(&TrainSpec, &DataSpec) -> Option<Doubt> + Send + Sync;

/// The largest requests that a server takes.
#[derive(Clone, Debug)]
pub struct Limits {
    /// Trajectories of one simulation.
    pub max_trajectories: u64,
    /// Seconds that an attempt at a task may take, of the kinds that have a limit. Jobs that ask for none get it.
    pub time_limits_s: HashMap<JobKind, u32>,
}

/// A spec of one kind, as a job among others.
pub(crate) trait Kind {
    /// The unit that its progress counts.
    fn unit(&self) -> &'static str;

    /// The tasks that workers lease.
    ///
    /// # Errors
    /// When there would be more than [`TASKS_PER_JOB`], or data that is needed is missing.
    fn tasks(&self, inputs: &Inputs) -> Result<Vec<NewTask>, SpecError>;

    fn output(&self) -> Output;

    /// How far earlier work of the same digest does for it.
    fn reuse(&self) -> JobReuse {
        JobReuse { whole: true, parts: PartReuse::Nothing }
    }

    /// # Errors
    /// Names each field that does not fit what the spec refers to.
    fn check_inputs(&self, _inputs: &Inputs) -> Result<(), SpecError> {
        Ok(())
    }

    /// # Errors
    /// Names each field that asks for more than this server takes.
    fn check_limits(&self, _limits: &Limits) -> Result<(), SpecError> {
        Ok(())
    }

    /// Jobs that must succeed first.
    fn needs(&self, inputs: &Inputs) -> Vec<Need> {
        inputs.needs.clone()
    }

    /// Its name outside a pipeline; `None` is its kind with the beginning of its digest.
    fn name(&self, _inputs: &Inputs) -> Option<String> {
        None
    }

    /// Why it may not fit into memory with the `data` that it reads.
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

/// The task at `ordinal` of its stage, which does `total` units.
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

//! Ids of rows, with one type for each table so that they cannot be mixed up.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::database::column::integer_column;

macro_rules! identifier {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(
            Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize,
        )]
        #[serde(transparent)]
        pub struct $name(pub i64);

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                self.0.fmt(f)
            }
        }

        integer_column!($name);
    };
}

identifier!(
    /// A job.
    JobId
);
identifier!(
    /// A task of a job.
    TaskId
);
identifier!(
    /// The record of a training or an evaluation.
    RunId
);
identifier!(
    /// A dataset.
    DatasetId
);
identifier!(
    /// A checkpoint.
    CheckpointId
);
identifier!(
    /// A robot.
    RobotId
);
identifier!(
    /// A token.
    TokenId
);
identifier!(
    /// An experiment of tracked runs.
    ExperimentId
);
identifier!(
    /// A run that a client of MLflow has logged.
    TrackedRunId
);
identifier!(
    /// A combination of resources that tasks ask for.
    ResourcesId
);
identifier!(
    /// The fencing number of a task. Every claim raises it by one.
    Epoch
);

/// A task and the epoch at which it was claimed. It gives a worker the right to write.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Fence {
    /// The leased task.
    pub task: TaskId,
    /// The number of the lease: one more at every claim of the task.
    pub epoch: Epoch,
}

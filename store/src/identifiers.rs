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

identifier!(JobId);
identifier!(TaskId);
identifier!(RunId);
identifier!(DatasetId);
identifier!(CheckpointId);
identifier!(TokenId);
identifier!(
    /// An experiment of tracked runs.
    ExperimentId
);
identifier!(TrackedRunId);
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
    pub task: TaskId,
    pub epoch: Epoch,
}

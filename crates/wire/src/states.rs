//! Words that JSON, SQL, the page and the command line share: the states of jobs, tasks and datasets,
//! the scopes of tokens, and the sort keys of lists.

use std::error::Error;
use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

macro_rules! states {
    ($(#[$about:meta])* $name:ident { $($(#[$meaning:meta])* $state:ident = $word:literal,)+ }) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, ToSchema)]
        #[serde(rename_all = "lowercase")]
        pub enum $name {
            $($(#[$meaning])* $state,)+
        }

        impl $name {
            /// All of them, in the order of their declaration.
            pub const ALL: [Self; [$($word),+].len()] = [$(Self::$state,)+];

            /// Their words, in the same order.
            pub const WORDS: [&'static str; Self::ALL.len()] = [$($word),+];

            /// The word in JSON and in the database.
            pub const fn as_str(self) -> &'static str {
                match self {
                    $(Self::$state => $word,)+
                }
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.pad(self.as_str())
            }
        }

        impl FromStr for $name {
            type Err = UnknownState;

            fn from_str(word: &str) -> Result<Self, UnknownState> {
                let state = Self::ALL.into_iter().find(|state| state.as_str() == word);
                state.ok_or_else(|| UnknownState(word.to_owned()))
            }
        }
    };
}

states! {
    /// The scope of a token. Each scope includes those before it.
    Scope {
        /// May read and download everything, and request predictions.
        Read = "read",
        /// May submit, cancel and retry jobs, and send recordings.
        Submit = "submit",
        /// May pause the queue, drain workers, and create and revoke tokens.
        Admin = "admin",
    }
}

states! {
    /// The state of a job. Final states never change.
    JobState {
        /// It waits for other jobs that it needs.
        Waiting = "waiting",
        /// Its tasks wait for workers.
        Queued = "queued",
        /// A worker has begun one of its tasks.
        Running = "running",
        /// All its tasks have succeeded; for a pipeline, all its jobs.
        Succeeded = "succeeded",
        /// One of its tasks has failed; for a pipeline, one of its jobs.
        Failed = "failed",
        /// Somebody cancelled it, or a job that it needs has failed or was cancelled.
        Cancelled = "cancelled",
    }
}

states! {
    /// The state of a task.
    TaskState {
        /// It waits for tasks of earlier stages, or for jobs that its job needs.
        Waiting = "waiting",
        /// It waits for a worker.
        Queued = "queued",
        /// A worker has it.
        Running = "running",
        /// It is done.
        Succeeded = "succeeded",
        /// It was claimed as often as allowed, or its error cannot pass.
        Failed = "failed",
        /// Its job ended before it did.
        Cancelled = "cancelled",
    }
}

states! {
    /// The kinds of stored events.
    EventKind {
        /// A job's state changed.
        Job = "job",
        /// A task's state changed.
        Task = "task",
        /// A run recorded metrics.
        Metrics = "metrics",
        /// A training wrote a checkpoint.
        Checkpoint = "checkpoint",
        /// An item was deleted or restored.
        Deletion = "deletion",
    }
}

states! {
    /// The change that a deletion or its end made.
    DeletionChange {
        /// It is in the trash.
        Deleted = "deleted",
        /// It came back from the trash.
        Restored = "restored",
        /// Its bytes and details were deleted for good.
        Purged = "purged",
    }
}

states! {
    /// How an attempt at a task ended.
    AttemptOutcome {
        /// The task is done.
        Succeeded = "succeeded",
        /// The task had an error, or the worker died.
        Failed = "failed",
        /// The worker was told to stop and gave the task back.
        Released = "released",
        /// The job was cancelled.
        Cancelled = "cancelled",
    }
}

states! {
    /// The state of a dataset.
    DatasetState {
        /// Some shards are missing.
        Building = "building",
        /// All shards exist.
        Complete = "complete",
        /// Some shards are missing, and the job that would make them failed or was cancelled.
        Abandoned = "abandoned",
    }
}

states! {
    /// The state of a worker that was requested from a cluster's engine.
    PlacementState {
        /// It waits for its place.
        Pending = "pending",
        /// It runs.
        Running = "running",
        /// It is gone.
        Ended = "ended",
    }
}

states! {
    /// A kind of item that has labels, is listed, and can be deleted.
    ItemKind {
        /// A job.
        Job = "job",
        /// The record of a training, an evaluation or a control job.
        Run = "run",
        /// A dataset with its files.
        Dataset = "dataset",
        /// A checkpoint with its files.
        Checkpoint = "checkpoint",
    }
}

states! {
    /// How a job depends on an item.
    Relation {
        /// Its spec refers to the data or the training.
        Reads = "reads",
        /// The job must succeed before it can start.
        Needs = "needs",
        /// It uses the work of a job with the same digest.
        Continues = "continues",
        /// It is a pipeline with the job as a member.
        Holds = "holds",
    }
}

states! {
    /// The sort key of a list. Items with equal keys are sorted by id.
    Sort {
        /// The time of creation, which is the order of ids.
        Created = "created",
        /// The time at which the job ended. Jobs that have not ended come after all others.
        Finished = "finished",
        /// The name, compared by bytes.
        Name = "name",
        /// The priority of the job.
        Priority = "priority",
        /// The number of trajectories.
        Trajectories = "trajectories",
        /// Optimizer steps taken.
        Step = "step",
        /// The error: of a training's or a checkpoint's latest validation, or the first one in the
        /// headline of an evaluation. Items without one come last in both directions.
        Rmse = "rmse",
    }
}

impl Sort {
    /// The key in words for a heading.
    pub const fn title(self) -> &'static str {
        match self {
            Self::Rmse => "RMSE",
            other => other.as_str(),
        }
    }
}

impl DatasetState {
    /// The state of a job that has the same colour.
    pub const fn colour(self) -> JobState {
        match self {
            Self::Building => JobState::Running,
            Self::Complete => JobState::Succeeded,
            Self::Abandoned => JobState::Failed,
        }
    }
}

impl Relation {
    /// The relation of the job to the item, as the end of a sentence.
    pub const fn phrase(self) -> &'static str {
        match self {
            Self::Reads => "reads it",
            Self::Needs => "needs it",
            Self::Continues => "continues from it",
            Self::Holds => "has it as a member",
        }
    }
}

impl JobState {
    /// Whether the job has ended.
    pub const fn is_final(self) -> bool {
        matches!(self, Self::Succeeded | Self::Failed | Self::Cancelled)
    }
}

/// A word that is not a state.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownState(pub String);

impl fmt::Display for UnknownState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "unknown state {:?}", self.0)
    }
}

impl Error for UnknownState {}

#[cfg(test)]
mod tests {
    use utoipa::PartialSchema as _;

    use super::*;

    #[test]
    fn every_state_is_the_same_word_in_json_in_text_and_in_the_schema() {
        for state in JobState::ALL {
            assert_eq!(serde_json::to_value(state).unwrap(), state.as_str());
            assert_eq!(state.as_str().parse(), Ok(state));
        }
        let schema = serde_json::to_value(JobState::schema()).unwrap();
        assert_eq!(schema["enum"], serde_json::json!(JobState::ALL));
        assert_eq!("done".parse::<JobState>(), Err(UnknownState("done".to_owned())));
    }
}

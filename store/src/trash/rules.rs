//! Items that can be deleted, and the jobs that prevent a deletion.

use std::fmt;

use spec::Digest;
use wire::{ItemKind, JobState, Relation};

use crate::{CheckpointId, DatasetId, JobId, RunId};

/// Something that can be deleted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Item {
    /// Which table of items it is in.
    pub kind: ItemKind,
    /// Its id among the items of its kind.
    pub id: i64,
}

/// A job that depends on an item.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Dependent {
    /// The job.
    pub job: JobId,
    /// The store does not interpret it.
    pub kind: String,
    /// The name of the job for people.
    pub name: String,
    /// Where the job stands.
    pub state: JobState,
    /// Why it depends on the item.
    pub relation: Relation,
    /// The digest of the job.
    pub digest: Digest,
}

/// The dependents that prevent a deletion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Respect {
    /// Every job that depends on the item.
    All,
    /// Only jobs that have not ended.
    Open,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Obstacle {
    /// The job that makes it has not ended.
    NotEnded,
    /// Jobs depend on it.
    Needed,
}

/// Jobs that have not ended always prevent the deletion of their inputs. Jobs that have ended only
/// record what they were made from.
pub(crate) fn obstacle(
    job: JobState,
    respect: Respect,
    dependents: &[Dependent],
) -> Option<Obstacle> {
    let counts = |dependent: &Dependent| respect == Respect::All || !dependent.state.is_final();
    if !job.is_final() {
        Some(Obstacle::NotEnded)
    } else if dependents.iter().any(counts) {
        Some(Obstacle::Needed)
    } else {
        None
    }
}

impl Item {
    /// The item of this kind with this id.
    pub const fn new(kind: ItemKind, id: i64) -> Self {
        Self { kind, id }
    }
}

impl From<JobId> for Item {
    fn from(JobId(id): JobId) -> Self {
        Self::new(ItemKind::Job, id)
    }
}

impl From<RunId> for Item {
    fn from(RunId(id): RunId) -> Self {
        Self::new(ItemKind::Run, id)
    }
}

impl From<DatasetId> for Item {
    fn from(DatasetId(id): DatasetId) -> Self {
        Self::new(ItemKind::Dataset, id)
    }
}

impl From<CheckpointId> for Item {
    fn from(CheckpointId(id): CheckpointId) -> Self {
        Self::new(ItemKind::Checkpoint, id)
    }
}

impl fmt::Display for Item {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.kind, self.id)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dependent(state: JobState) -> Dependent {
        let (kind, name) = ("train".to_owned(), "t".to_owned());
        let (relation, digest) = (Relation::Reads, Digest::of(b""));
        Dependent { job: JobId(1), kind, name, state, relation, digest }
    }

    #[test]
    fn a_job_that_has_not_ended_keeps_what_it_reads_whatever_is_respected() {
        for state in JobState::ALL {
            let dependents = [dependent(state)];
            let open = obstacle(JobState::Succeeded, Respect::Open, &dependents);
            assert_eq!(open.is_some(), !state.is_final(), "{state}");
            let all = obstacle(JobState::Succeeded, Respect::All, &dependents);
            assert_eq!(all, Some(Obstacle::Needed));
        }
        assert_eq!(obstacle(JobState::Failed, Respect::All, &[]), None);
        assert_eq!(obstacle(JobState::Running, Respect::Open, &[]), Some(Obstacle::NotEnded));
    }
}

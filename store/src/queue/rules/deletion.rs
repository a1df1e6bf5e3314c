//! Dependents: the jobs that prevent a deletion.

use wire::JobState;

use crate::{Dependent, Respect};

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

#[cfg(test)]
mod tests {
    use spec::Digest;
    use wire::Relation;

    use super::*;
    use crate::JobId;

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

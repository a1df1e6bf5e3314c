//! The workers that could take a task.

use spec::Resources;

use crate::Worker;

/// Where a task with given resource demands could run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Placement {
    /// On a live worker, once it is free.
    Possible,
    /// Only on these workers, which are alive and drained.
    Drained(Vec<String>),
    Nowhere,
}

pub(crate) fn placement(asked: &Resources, workers: &[Worker]) -> Placement {
    let fitting =
        || workers.iter().filter(|worker| worker.is_alive && worker.process.offers.cover(asked));
    if fitting().any(|worker| worker.drained_at.is_none()) {
        return Placement::Possible;
    }
    let drained: Vec<String> = fitting().map(|worker| worker.process.name.clone()).collect();
    if drained.is_empty() { Placement::Nowhere } else { Placement::Drained(drained) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Timestamp, WorkerProcess};

    fn worker(name: &str, gpus: u32, is_alive: bool, is_drained: bool) -> Worker {
        let moment = Timestamp::from_milliseconds(0);
        let process = WorkerProcess {
            name: name.to_owned(),
            host: "lab-3".to_owned(),
            pid: 1,
            version: "1.2.3".to_owned(),
            device: "cpu".to_owned(),
            threads: 2,
            offers: Resources { gpus, ..Resources::default() },
        };
        Worker {
            process,
            drained_at: is_drained.then_some(moment),
            waits_for: None,
            started_at: moment,
            seen_at: moment,
            is_alive,
            task: None,
        }
    }

    #[test]
    fn a_task_goes_to_the_living_that_offer_enough_and_are_not_drained() {
        let asked = Resources { gpus: 1, ..Resources::default() };
        let mut workers = vec![worker("small", 0, true, false), worker("dead", 1, false, false)];
        assert_eq!(placement(&asked, &workers), Placement::Nowhere);
        assert_eq!(placement(&Resources::default(), &workers), Placement::Possible);
        workers.push(worker("drained", 4, true, true));
        assert_eq!(placement(&asked, &workers), Placement::Drained(vec!["drained".to_owned()]));
        workers.push(worker("idle", 1, true, false));
        assert_eq!(placement(&asked, &workers), Placement::Possible);
    }
}

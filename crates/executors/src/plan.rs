//! The plan: which workers to request and which to end. It depends only on the waiting tasks and
//! the workers.
//!
//! A waiting task is worth one worker. A worker that is idle or still to come serves one of the
//! waiting tasks whose needs it covers. Workers are requested for the other tasks, up to the
//! maximum. Workers that find no task end by themselves. The plan ends a worker only if no task
//! waits for it, or if it is in the way: at the maximum, a task that no worker covers gets the
//! place of a worker that has a duplicate.

use std::cmp::Reverse;
use std::time::Duration;

use spec::Resources;
use store::Demand;

use crate::resources::rarity;

/// Limits of the number of workers from an engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bounds {
    /// Number of workers that are kept even while nothing waits.
    pub min: usize,
    /// Largest number of workers, those that wait for their place included.
    pub max: usize,
}

/// A worker, with the facts that matter to the plan.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownWorker {
    /// The name under which it reports to the store.
    pub name: String,
    /// The resources that it offers to tasks.
    pub resources: Resources,
    /// Whether it could take a task now.
    pub state: WorkerState,
    /// Whether it was requested from the engine. Others come and go by themselves.
    pub is_ours: bool,
    /// Whether it keeps running when it finds no task.
    pub stays: bool,
    /// Why it claims no more tasks, if there is a reason. Completes "it is let go: ...".
    pub claims_nothing: Option<&'static str>,
}

/// The state of a worker, as far as the plan depends on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WorkerState {
    /// It has waited for its place for this long.
    Pending(Duration),
    /// It has no task.
    Idle,
    /// It has a task.
    Busy,
    /// It was told to end.
    Ending,
}

/// A step of the plan.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// Request a worker from the engine.
    Ask {
        /// The resources that the worker must offer to tasks.
        resources: Resources,
        /// Whether the worker keeps running when it finds no task.
        stays: bool,
    },
    /// End a worker that has no task.
    LetGo {
        /// Its name.
        worker: String,
        /// The text completes "it is let go: ...".
        why: &'static str,
    },
}

/// A worker that no task waits for any more is ended after it has waited this long for its place,
/// because demand changes.
pub const SETTLED_AFTER: Duration = Duration::from_secs(30);

/// The actions to take. Requested workers have at least `usual`.
pub fn plan(
    demand: &[Demand],
    workers: &[KnownWorker],
    bounds: Bounds,
    usual: &Resources,
) -> Vec<Action> {
    let ours = workers.iter().filter(|worker| worker.is_ours);
    let staying = ours.clone().filter(|worker| worker.stays && worker.is_useful()).count();
    let mut room = bounds.max.saturating_sub(ours.count());
    let mut asks = Vec::new();
    for _ in 0..bounds.min.saturating_sub(staying).min(room) {
        asks.push(Action::Ask { resources: usual.clone(), stays: true });
        room -= 1;
    }

    let Matched { mut unmet, spare } = matched(demand, workers, &vec![usual; asks.len()]);
    let is_served = |needed: &Resources| {
        let covers = |worker: &KnownWorker| worker.is_useful() && worker.resources.cover(needed);
        workers.iter().any(covers)
    };
    // Demand that no worker can serve comes first.
    unmet.sort_by_key(|(demand, _)| is_served(&demand.resources));
    while room > 0 && !unmet.is_empty() {
        for (demand, waiting) in &mut unmet {
            if room == 0 {
                break;
            }
            asks.push(Action::Ask { resources: usual.and(&demand.resources), stays: false });
            *waiting -= 1;
            room -= 1;
        }
        unmet.retain(|(_, waiting)| *waiting > 0);
    }

    let is_asked_for = |needed: &Resources| {
        asks.iter()
            .any(|ask| matches!(ask, Action::Ask { resources, .. } if resources.cover(needed)))
    };
    let starving = demand.iter().filter(|demand| {
        let needed = &demand.resources;
        demand.waiting > 0 && !is_served(needed) && !is_asked_for(needed)
    });
    let mut leaving = Leaving { workers, spare: &spare, names: Vec::new() };
    leaving.end_useless();
    leaving.end_unneeded(staying.saturating_sub(bounds.min));
    leaving.end_above(bounds.max);
    leaving.make_room(starving.count());
    let let_go = leaving.names.into_iter();
    asks.extend(let_go.map(|(worker, why)| Action::LetGo { worker: worker.to_owned(), why }));
    asks
}

impl KnownWorker {
    /// Whether it does tasks, now or later.
    fn is_useful(&self) -> bool {
        self.claims_nothing.is_none() && self.state != WorkerState::Ending
    }

    fn is_pending(&self) -> bool {
        matches!(self.state, WorkerState::Pending(_))
    }

    /// Whether it can take a task that waits.
    fn is_available(&self) -> bool {
        self.is_useful() && self.state != WorkerState::Busy
    }
}

/// An assignment of workers to demand.
struct Matched<'a> {
    /// Demand that no worker serves, the rarest first.
    unmet: Vec<(&'a Demand, u64)>,
    /// Names of available workers that serve no demand.
    spare: Vec<&'a str>,
}

/// Gives every waiting task an available or a requested worker. The rarest need goes first and
/// takes the most common worker that covers it. Existing workers come before requested ones.
fn matched<'a>(
    demand: &'a [Demand],
    workers: &'a [KnownWorker],
    asked: &[&Resources],
) -> Matched<'a> {
    let available = workers.iter().filter(|worker| worker.is_available());
    let mut free: Vec<(Option<&KnownWorker>, &Resources)> = available
        .map(|worker| (Some(worker), &worker.resources))
        .chain(asked.iter().map(|resources| (None, *resources)))
        .collect();
    free.sort_by_key(|(worker, resources)| {
        (worker.is_none_or(KnownWorker::is_pending), rarity(resources))
    });
    let mut rarest_first: Vec<&Demand> = demand.iter().collect();
    rarest_first.sort_by_key(|demand| Reverse(rarity(&demand.resources)));
    let mut unmet = Vec::new();
    for demand in rarest_first {
        let mut waiting = demand.waiting;
        free.retain(|(_, resources)| {
            let serves = waiting > 0 && resources.cover(&demand.resources);
            waiting -= u64::from(serves);
            !serves
        });
        if waiting > 0 {
            unmet.push((demand, waiting));
        }
    }
    let spare = free.iter().filter_map(|(worker, _)| worker.map(|worker| worker.name.as_str()));
    Matched { unmet, spare: spare.collect() }
}

/// Workers to end, with reasons.
struct Leaving<'a> {
    workers: &'a [KnownWorker],
    spare: &'a [&'a str],
    names: Vec<(&'a str, &'static str)>,
}

impl<'a> Leaving<'a> {
    /// The engine's workers that were not told to end yet.
    fn candidates(&self) -> impl Iterator<Item = &'a KnownWorker> {
        let told: Vec<&str> = self.names.iter().map(|(name, _)| *name).collect();
        self.workers.iter().filter(move |worker| {
            worker.is_ours
                && worker.state != WorkerState::Ending
                && !told.contains(&worker.name.as_str())
        })
    }

    fn is_spare(&self, worker: &KnownWorker) -> bool {
        self.spare.contains(&worker.name.as_str())
    }

    /// Ends idle workers that claim no more tasks.
    fn end_useless(&mut self) {
        let useless = self
            .candidates()
            .filter(|worker| worker.state != WorkerState::Busy)
            .filter_map(|worker| Some((worker.name.as_str(), worker.claims_nothing?)));
        let names: Vec<_> = useless.collect();
        self.names.extend(names);
    }

    /// Ends workers that no task waits for, and workers that keep running although fewer should.
    fn end_unneeded(&mut self, mut too_many_stay: usize) {
        let mut names = Vec::new();
        for worker in self.candidates().filter(|worker| self.is_spare(worker)) {
            let has_settled =
                matches!(worker.state, WorkerState::Pending(since) if since >= SETTLED_AFTER);
            let leaves = if worker.stays { too_many_stay > 0 } else { has_settled };
            if leaves {
                too_many_stay = too_many_stay.saturating_sub(usize::from(worker.stays));
                names.push((worker.name.as_str(), "no task waits for it"));
            }
        }
        self.names.extend(names);
    }

    /// Ends workers above the maximum, those with the least to lose first.
    fn end_above(&mut self, max: usize) {
        let excess = self.candidates().count().saturating_sub(max);
        let mut by_loss: Vec<&KnownWorker> = self.candidates().collect();
        by_loss.sort_by_key(|worker| {
            (worker.state == WorkerState::Busy, !self.is_spare(worker), !worker.is_pending())
        });
        let names = by_loss.into_iter().take(excess).map(|worker| worker.name.as_str());
        self.names.extend(names.map(|name| (name, "there are more workers than allowed")));
    }

    /// Ends one worker for each need that no worker covers, unless a place will be free soon. It is
    /// a spare worker, or one with a duplicate.
    fn make_room(&mut self, starving: usize) {
        let ending = self
            .workers
            .iter()
            .filter(|worker| worker.is_ours && worker.state == WorkerState::Ending);
        let about_to_be_free = ending.count() + self.names.len();
        for _ in about_to_be_free..starving {
            let mut by_loss: Vec<&KnownWorker> = self
                .candidates()
                .filter(|worker| !worker.stays)
                .filter(|worker| self.is_spare(worker) || self.has_equivalent(worker))
                .collect();
            by_loss.sort_by_key(|worker| {
                (!self.is_spare(worker), worker.state == WorkerState::Busy, !worker.is_pending())
            });
            let Some(worker) = by_loss.first() else { return };
            self.names.push((worker.name.as_str(), "tasks that no worker can do need its place"));
        }
    }

    /// Whether another of the engine's workers can do the same tasks.
    fn has_equivalent(&self, worker: &KnownWorker) -> bool {
        let mut others = self.candidates().filter(|other| other.name != worker.name);
        others.any(|other| other.is_useful() && other.resources.cover(&worker.resources))
    }
}

//! The memory of the autoscaler from one look to the next.

use std::collections::{HashMap, HashSet};
use std::time::{Duration, Instant};

use spec::Resources;
use store::Worker;

use crate::backoff::Backoff;
use crate::refusals::Refusals;
use crate::{KnownWorker, Phase, PlacedWorker, WorkerState};

/// It avoids repeated requests and keeps reasons for reports. Losing it does no harm.
#[derive(Debug)]
pub struct Memory {
    /// Requested workers that the engine does not show yet.
    pub asked: HashMap<String, RequestedWorker>,
    /// Workers that were asked to end, with the reason.
    pub let_go: HashMap<String, &'static str>,
    /// Workers that have begun.
    pub began: HashSet<String>,
    pub refusals: Refusals,
    pub looking: Backoff,
    /// Why no worker can be requested at the moment.
    pub stopped: Option<String>,
    /// Why no workers come, as it was last reported.
    pub told: Option<Option<String>>,
    /// When each worker began to wait for its place.
    pending: HashMap<String, Instant>,
    /// No worker is requested before this moment.
    asking_from: Instant,
    asking: Backoff,
    /// Why workers end before they begin. Reset when one begins.
    unable: Option<String>,
}

/// A worker that was requested.
#[derive(Debug)]
pub struct RequestedWorker {
    pub resources: Resources,
    pub stays: bool,
    pub at: Instant,
}

/// How long a request counts as pending if the engine does not show it.
const ASTRAY_AFTER: Duration = Duration::from_secs(60);

const LONGEST_PAUSE: Duration = Duration::from_secs(60);

/// The longest pause between two requests that fail.
const LONGEST_PAUSE_OF_ASKING: Duration = Duration::from_secs(300);

impl Memory {
    /// Pauses begin at `first`.
    pub fn new(first: Duration) -> Self {
        let longest = LONGEST_PAUSE_OF_ASKING.max(first);
        Self {
            asked: HashMap::new(),
            let_go: HashMap::new(),
            began: HashSet::new(),
            refusals: Refusals::new(first, longest),
            looking: Backoff::new(first, LONGEST_PAUSE.max(first)),
            stopped: None,
            told: None,
            pending: HashMap::new(),
            asking_from: Instant::now(),
            asking: Backoff::new(first, longest),
            unable: None,
        }
    }

    /// Why no workers come, if there is a reason.
    pub fn obstacle(&self) -> Option<String> {
        let told = self.stopped.as_deref().or(self.unable.as_deref());
        told.or(self.refusals.why()).map(str::to_owned)
    }

    pub fn may_ask_for(&self, offer: &Resources) -> bool {
        let now = Instant::now();
        now >= self.asking_from && !self.refusals.hold(offer, now)
    }

    pub fn stop_asking(&mut self, why: String) {
        self.stopped = Some(why);
        self.pause_asking();
    }

    pub fn worker_ended_before_it_began(&mut self, why: String) {
        self.unable = Some(why);
        self.pause_asking();
    }

    fn pause_asking(&mut self) {
        self.asking_from = Instant::now() + self.asking.fail();
    }

    /// Records workers that began. They show that requests lead to working workers.
    pub fn workers_began(&mut self, names: Vec<String>) {
        self.asking.reset();
        self.asking_from = Instant::now();
        self.unable = None;
        self.began.extend(names);
    }

    pub fn forget_missing(&mut self, placed: &[PlacedWorker], registered: &[Worker]) {
        self.asked.retain(|_, asked| asked.at.elapsed() < ASTRAY_AFTER);
        let registered = registered.iter().map(|worker| &worker.process.name);
        let there: HashSet<&String> =
            placed.iter().map(|worker| &worker.name).chain(registered).collect();
        self.began.retain(|name| there.contains(name));
        self.let_go.retain(|name, _| there.contains(name));
    }

    /// The workers that matter to the plan: those of the engine, requested ones, and those that
    /// somebody else started. The names of the engine's workers begin with `ours`.
    pub fn known(
        &mut self,
        placed: &[PlacedWorker],
        registered: &[Worker],
        ours: &str,
        version: &str,
    ) -> Vec<KnownWorker> {
        let now = Instant::now();
        let live = placed.iter().filter(|worker| !matches!(worker.phase, Phase::Ended(_)));
        let waiting: HashSet<&String> = live
            .clone()
            .filter(|worker| matches!(worker.phase, Phase::Pending(_)))
            .map(|worker| &worker.name)
            .collect();
        self.pending.retain(|name, _| waiting.contains(name));
        let mut known = Vec::new();
        for worker in live {
            let own = registered.iter().find(|own| own.process.name == worker.name);
            let state = match &worker.phase {
                _ if self.let_go.contains_key(&worker.name) => WorkerState::Ending,
                Phase::Pending(_) => {
                    let since = *self.pending.entry(worker.name.clone()).or_insert(now);
                    WorkerState::Pending(now.saturating_duration_since(since))
                }
                Phase::Ending(_) | Phase::Ended(_) => WorkerState::Ending,
                // A worker that hangs does no work.
                Phase::Running if own.is_some_and(|own| own.task.is_some() || !own.is_alive) => {
                    WorkerState::Busy
                }
                Phase::Running => WorkerState::Idle,
            };
            known.push(KnownWorker {
                name: worker.name.clone(),
                resources: worker.resources.clone(),
                state,
                is_ours: true,
                stays: worker.stays,
                claims_nothing: own.and_then(|own| why_it_claims_nothing(own, version)),
            });
        }
        known.extend(self.asked.iter().map(|(name, asked)| KnownWorker {
            name: name.clone(),
            resources: asked.resources.clone(),
            state: WorkerState::Pending(Duration::ZERO),
            is_ours: true,
            stays: asked.stays,
            claims_nothing: None,
        }));
        let others = registered
            .iter()
            .filter(|worker| worker.is_alive && !worker.process.name.starts_with(ours));
        known.extend(others.map(|worker| KnownWorker {
            name: worker.process.name.clone(),
            resources: worker.process.offers.clone(),
            state: if worker.task.is_some() { WorkerState::Busy } else { WorkerState::Idle },
            is_ours: false,
            stays: true,
            claims_nothing: why_it_claims_nothing(worker, version),
        }));
        known
    }
}

/// Why a worker claims no tasks of a server with this version, if there is a reason.
fn why_it_claims_nothing(worker: &Worker, version: &str) -> Option<&'static str> {
    if worker.process.version != version {
        return Some("it is of another version");
    }
    worker.drained_at.map(|_| "it is drained")
}

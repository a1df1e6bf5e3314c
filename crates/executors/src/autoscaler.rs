//! The autoscaler: looks at waiting tasks and at workers, and asks the engine to place workers or
//! to end them.

use std::collections::HashMap;
use std::time::{Duration, Instant};

use spec::Resources;
use store::{
    Demand, Duty, DutyClaim, Placed, Placement, PlacementState, Store, StoreError, Worker,
    WorkerEnd,
};
use tokio_util::sync::CancellationToken;

use crate::memory::{Memory, RequestedWorker};
use crate::resources::written;
use crate::worker_command::{new_name, prefix};
use crate::{Action, Ask, Bounds, Cause, End, Engine, EngineError, Phase, PlacedWorker, plan};

/// Options for requesting workers from an engine.
#[derive(Clone, Debug)]
pub struct Settings {
    /// How many workers there may be.
    pub bounds: Bounds,
    /// The least that every worker offers.
    pub usual: Resources,
    /// Pause between two looks.
    pub look_every: Duration,
    /// The version of this program. Workers of another version claim no tasks.
    pub version: String,
}

/// Asks a cluster's engine for as many workers as a store's queue needs. If several servers share the
/// store, one of them runs it.
#[derive(Debug)]
pub struct Autoscaler {
    store: Store,
    /// The store's identity.
    identity: String,
    engine: Engine,
    settings: Settings,
    duty: DutyClaim,
    memory: Memory,
}

/// Why a look failed.
#[derive(Debug, thiserror::Error)]
enum LookError {
    #[error(transparent)]
    Engine(#[from] EngineError),
    #[error(transparent)]
    Store(#[from] StoreError),
}

impl Autoscaler {
    /// # Errors
    /// When the database fails.
    pub async fn new(store: Store, engine: Engine, settings: Settings) -> Result<Self, StoreError> {
        let identity = store.identity().await?;
        let duty = store.duty(Duty::Placing);
        let memory = Memory::new(settings.look_every);
        let mut autoscaler = Self { store, identity, engine, settings, duty, memory };
        if autoscaler.duty.is_mine().await? {
            autoscaler.show_engine(None).await?;
        }
        Ok(autoscaler)
    }

    /// Looks regularly until `stop`. Workers outlive the server: they do the waiting tasks and then
    /// end.
    pub async fn run(mut self, stop: CancellationToken) {
        loop {
            let Some(pause) = stop.run_until_cancelled(self.take_turn()).await else { return };
            if stop.run_until_cancelled(tokio::time::sleep(pause)).await.is_none() {
                return;
            }
        }
    }

    /// Looks if this server has the duty. Returns the pause until the next turn.
    async fn take_turn(&mut self) -> Duration {
        match self.duty.is_mine().await {
            Ok(true) => return self.look().await,
            // Another server has the duty and may change the engine's workers.
            Ok(false) => self.memory = Memory::new(self.settings.look_every),
            Err(error) => {
                let error = spec::causes(&error);
                tracing::warn!("cannot tell whether to look after workers: {error}");
            }
        }
        self.settings.look_every
    }

    /// Looks once and takes the planned actions. Returns the pause until the next look.
    pub async fn look(&mut self) -> Duration {
        match self.try_to_look().await {
            Ok(obstacle) => {
                self.memory.looking.reset();
                self.tell(obstacle).await;
                self.settings.look_every
            }
            Err(LookError::Engine(error)) => {
                let said = spec::causes(&error);
                self.tell(Some(format!("no workers can be requested: {said}"))).await;
                self.memory.looking.fail()
            }
            Err(LookError::Store(error)) => {
                tracing::error!("cannot look after workers: {}", spec::causes(&error));
                self.memory.looking.fail()
            }
        }
    }

    /// Returns why no workers come, if there is a reason.
    async fn try_to_look(&mut self) -> Result<Option<String>, LookError> {
        // The order matters. A worker that claims a task in between counts as idle, so no worker is
        // requested in vain.
        let placed = self.engine.workers().await?;
        let registered = self.store.workers().await?;
        self.settle(&placed, &registered).await?;
        let demand = self.demand().await?;
        let ours = prefix(&self.identity);
        let known = self.memory.known(&placed, &registered, &ours, &self.settings.version);
        let actions = plan(&demand, &known, self.settings.bounds, &self.settings.usual);
        self.act(actions, &placed).await?;
        Ok(self.memory.obstacle())
    }

    /// The waiting tasks, without those that need an offer that the engine refused a moment ago.
    async fn demand(&mut self) -> Result<Vec<Demand>, StoreError> {
        let mut demand = self.store.demand().await?;
        let usual = &self.settings.usual;
        let refusals = &mut self.memory.refusals;
        refusals.keep(|offer| {
            offer == usual || demand.iter().any(|demanded| usual.and(&demanded.resources) == *offer)
        });
        let now = Instant::now();
        demand.retain(|demanded| !refusals.hold(&usual.and(&demanded.resources), now));
        Ok(demand)
    }

    /// Ends the tasks of workers that ended, and records the engine's view of all workers.
    async fn settle(
        &mut self,
        placed: &[PlacedWorker],
        registered: &[Worker],
    ) -> Result<(), LookError> {
        let ours = prefix(&self.identity);
        let names = registered.iter().map(|worker| &worker.process.name);
        let newcomers: Vec<String> = names
            .filter(|name| name.starts_with(&ours) && !self.memory.began.contains(*name))
            .cloned()
            .collect();
        if !newcomers.is_empty() {
            self.memory.workers_began(newcomers);
        }

        let records = self.store.placements().await?;
        let records: HashMap<&str, &Placement> =
            records.iter().map(|record| (record.placed.worker.as_str(), record)).collect();
        let has_ended = |record: &&Placement| record.placed.state == PlacementState::Ended;
        let mut changed = Vec::new();
        for worker in placed {
            self.memory.asked.remove(&worker.name);
            let record = records.get(worker.name.as_str()).copied();
            if record.as_ref().is_some_and(has_ended) {
                continue;
            }
            let mut worker = worker.clone();
            if let Phase::Ended(end) = &mut worker.phase {
                if let Some(why) = self.memory.let_go.get(&worker.name) {
                    *end = end_of_released(why);
                }
                self.take_back(&worker.name, end).await?;
                if end.cause == Cause::Died && !self.has_begun(&worker.name).await? {
                    let engine = self.engine.name();
                    let how = format!("{} {}", worker.name, end.how);
                    let why = format!("workers of {engine} end before they begin: {how}");
                    self.memory.worker_ended_before_it_began(why);
                }
            }
            let placed = self.record_of(&worker);
            if record.is_none_or(|record| record.placed != placed) {
                changed.push(placed);
            }
        }
        for record in records.values().filter(|record| !has_ended(record)) {
            let name = &record.placed.worker;
            if !placed.iter().any(|worker| worker.name == *name)
                && !self.memory.asked.contains_key(name)
            {
                changed.push(self.gone(record).await?);
            }
        }
        if !changed.is_empty() {
            self.store.record_placements(&changed).await?;
        }
        self.memory.forget_missing(placed, registered);
        Ok(())
    }

    /// Whether a worker ever showed itself. It may have come, begun a task and gone between two
    /// looks.
    async fn has_begun(&self, worker: &str) -> Result<bool, LookError> {
        Ok(self.memory.began.contains(worker) || self.store.has_begun_a_task(worker).await?)
    }

    /// A worker that the engine no longer shows. If its end is not known, its lease decides.
    async fn gone(&self, record: &Placement) -> Result<Placed, LookError> {
        let name = &record.placed.worker;
        let end = match self.memory.let_go.get(name) {
            Some(why) => Some(end_of_released(why)),
            None => self.engine.remembers(name).await,
        };
        if let Some(end) = &end {
            self.take_back(name, end).await?;
        }
        let unknown = || format!("is gone, and {} does not say why", self.engine.name());
        let reason = Some(end.map_or_else(unknown, |end| end.how));
        Ok(Placed { state: PlacementState::Ended, reason, ..record.placed.clone() })
    }

    /// Gives the task of an ended worker to another one, without waiting for its lease to expire.
    async fn take_back(&self, worker: &str, end: &End) -> Result<(), LookError> {
        let ended = match end.cause {
            Cause::Finished => WorkerEnd::Stopped,
            Cause::Interrupted => WorkerEnd::Interrupted(&end.how),
            Cause::Died => WorkerEnd::Died(&end.how),
        };
        self.store.take_back(worker, ended).await?;
        match end.cause {
            Cause::Died => tracing::warn!("worker {worker} {}", end.how),
            Cause::Finished | Cause::Interrupted => tracing::info!("worker {worker} {}", end.how),
        }
        Ok(())
    }

    fn record_of(&self, worker: &PlacedWorker) -> Placed {
        let (state, reason) = match &worker.phase {
            Phase::Pending(why) => (PlacementState::Pending, why.clone()),
            Phase::Running => (PlacementState::Running, None),
            Phase::Ending(why) => {
                let is_ending = || "is ending".to_owned();
                (PlacementState::Running, Some(why.clone().unwrap_or_else(is_ending)))
            }
            Phase::Ended(end) => (PlacementState::Ended, Some(end.how.clone())),
        };
        Placed {
            worker: worker.name.clone(),
            engine: self.engine.name().to_owned(),
            identifier: Some(worker.identifier.clone()),
            state,
            reason,
            node: worker.node.clone(),
        }
    }

    async fn act(
        &mut self,
        actions: Vec<Action>,
        placed: &[PlacedWorker],
    ) -> Result<(), LookError> {
        if !actions.iter().any(|action| matches!(action, Action::Ask { .. })) {
            self.memory.stopped = None;
        }
        for action in actions {
            match action {
                Action::Ask { resources, stays } => {
                    if self.memory.may_ask_for(&resources) {
                        let name = new_name(&self.identity);
                        self.ask(Ask { name, resources, stays }).await?;
                    }
                }
                Action::LetGo { worker, why } => {
                    let Some(placed) = placed.iter().find(|placed| placed.name == worker) else {
                        continue;
                    };
                    tracing::info!("ends worker {worker}: {why}");
                    self.engine.let_go(&worker, &placed.identifier).await?;
                    self.memory.let_go.insert(worker, why);
                }
            }
        }
        Ok(())
    }

    /// Requests one worker, and remembers a refusal of the engine.
    async fn ask(&mut self, ask: Ask) -> Result<(), StoreError> {
        let answer = self.engine.ask(&ask).await;
        let Ask { name, resources, stays } = ask;
        if answer.as_ref().err().is_none_or(EngineError::is_uncertain) {
            let resources = resources.clone();
            let asked = RequestedWorker { resources, stays, at: Instant::now() };
            self.memory.asked.insert(name.clone(), asked);
        }
        let identifier = match answer {
            Ok(identifier) => identifier,
            Err(error) => {
                let why = spec::causes(&error);
                let why = format!("no more workers can be requested: {why}");
                if error.is_of_this_request() {
                    self.memory.refusals.add(&resources, why, Instant::now());
                } else {
                    self.memory.stop_asking(why);
                }
                return Ok(());
            }
        };
        self.memory.refusals.end(&resources);
        self.memory.stopped = None;
        let engine = self.engine.name();
        tracing::info!("asked {engine} for worker {name} with {}", written(&resources));
        let placed = Placed {
            worker: name,
            engine: engine.to_owned(),
            identifier: Some(identifier),
            state: PlacementState::Pending,
            reason: None,
            node: None,
        };
        self.store.record_placements(&[placed]).await
    }

    /// Reports once why no workers come, and once that they come again.
    async fn tell(&mut self, obstacle: Option<String>) {
        if self.memory.told.as_ref() == Some(&obstacle) {
            return;
        }
        match (&obstacle, &self.memory.told) {
            (Some(obstacle), _) => tracing::warn!("{obstacle}"),
            (None, Some(Some(_))) => {
                tracing::info!("{} places workers again", self.engine.name());
            }
            (None, _) => {}
        }
        if let Err(error) = self.show_engine(obstacle).await {
            tracing::error!("cannot show the engine: {}", spec::causes(&error));
        }
    }

    async fn show_engine(&mut self, obstacle: Option<String>) -> Result<(), StoreError> {
        let name = self.engine.name().to_owned();
        let engine = store::Engine { name, obstacle };
        self.store.set_engine(Some(&engine)).await?;
        self.memory.told = Some(engine.obstacle);
        Ok(())
    }
}

fn end_of_released(why: &str) -> End {
    End { cause: Cause::Interrupted, how: format!("was let go: {why}") }
}

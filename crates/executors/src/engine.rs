//! The engine of a cluster: the requests to it and its answers.

use spec::Resources;

use crate::{EngineError, Kubernetes, Slurm};

/// The engine that places workers.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "a server has one")]
pub enum Engine {
    Slurm(Slurm),
    Kubernetes(Box<Kubernetes>),
}

/// A worker to request.
#[derive(Clone, Debug, PartialEq)]
pub struct Ask {
    /// Unique among the workers of all stores. Requesting twice under one name makes one worker.
    pub name: String,
    /// The resources that it offers to tasks.
    pub resources: Resources,
    /// Whether it keeps running when it finds no task.
    pub stays: bool,
}

/// A worker in the engine's view.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacedWorker {
    /// The name under which it reports to the store.
    pub name: String,
    /// The engine's name for it.
    pub identifier: String,
    /// The resources that it offers to tasks.
    pub resources: Resources,
    /// Whether it keeps running when it finds no task.
    pub stays: bool,
    /// The node on which it runs or ran.
    pub node: Option<String>,
    /// Whether it waits, runs or has ended.
    pub phase: Phase,
}

/// The phase of a worker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Phase {
    /// It waits for its place, for this reason.
    Pending(Option<String>),
    /// It runs, whether or not it has a task.
    Running,
    /// It was told to end, for this reason.
    Ending(Option<String>),
    /// It is gone, and its task may go to another worker.
    Ended(End),
}

/// How a worker ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct End {
    /// Whether its task is to blame.
    pub cause: Cause,
    /// The text completes "worker NAME ...".
    pub how: String,
}

/// The consequence of a worker's end for its task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The worker ended normally.
    Finished,
    /// An outside cause ended it, and its task is not to blame.
    Interrupted,
    /// It died, and its task may be to blame.
    Died,
}

impl Engine {
    /// The engine's name, as people write it.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Slurm(_) => "Slurm",
            Self::Kubernetes(_) => "Kubernetes",
        }
    }

    /// The workers of this store, including those that ended recently.
    ///
    /// # Errors
    /// When the engine does not answer, refuses or cannot be understood.
    pub async fn workers(&self) -> Result<Vec<PlacedWorker>, EngineError> {
        match self {
            Self::Slurm(slurm) => slurm.workers().await,
            Self::Kubernetes(kubernetes) => kubernetes.workers().await,
        }
    }

    /// Requests a worker. Returns the engine's name for it.
    ///
    /// # Errors
    /// Like [`Engine::workers`].
    pub async fn ask(&self, ask: &Ask) -> Result<String, EngineError> {
        match self {
            Self::Slurm(slurm) => slurm.ask(ask).await,
            Self::Kubernetes(kubernetes) => kubernetes.ask(ask).await,
        }
    }

    /// Withdraws a worker's request, or tells the worker to give its task back and end.
    ///
    /// # Errors
    /// Like [`Engine::workers`]. A worker that is already gone is no error.
    pub async fn let_go(&self, name: &str, identifier: &str) -> Result<(), EngineError> {
        match self {
            Self::Slurm(slurm) => slurm.let_go(identifier).await,
            Self::Kubernetes(kubernetes) => kubernetes.let_go(name).await,
        }
    }

    /// How a worker ended that the engine no longer shows; `None` if the engine does not remember.
    pub async fn remembers(&self, name: &str) -> Option<End> {
        match self {
            Self::Slurm(slurm) => slurm.remembers(name).await,
            // A Job that was deleted is forgotten.
            Self::Kubernetes(_) => None,
        }
    }
}

//! The questions to a cluster's engine and its answers.

use spec::Resources;

use crate::{EngineError, Kubernetes, Slurm};

/// The engine that places workers.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "a server has one")]
pub enum Engine {
    Slurm(Slurm),
    Kubernetes(Box<Kubernetes>),
}

/// A worker to ask for.
#[derive(Clone, Debug, PartialEq)]
pub struct Ask {
    /// As no other worker of any store has; asking twice under one name makes one worker.
    pub name: String,
    /// The resources that it offers to tasks.
    pub resources: Resources,
    /// Whether it stays when it finds no task.
    pub stays: bool,
}

/// A worker as its engine shows it.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacedWorker {
    pub name: String,
    /// The engine's name for it.
    pub identifier: String,
    /// The resources that it offers to tasks.
    pub resources: Resources,
    pub stays: bool,
    /// Where it runs or ran.
    pub node: Option<String>,
    pub phase: Phase,
}

/// Where a worker stands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Phase {
    /// It waits for its place, and why.
    Pending(Option<String>),
    Running,
    /// It was told to end, and why.
    Ending(Option<String>),
    Ended(End),
}

/// How a worker ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct End {
    pub cause: Cause,
    /// Completes "worker NAME ...".
    pub how: String,
}

/// The meaning of a worker's end for the task that it had.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The worker ended in order.
    Finished,
    /// Something from outside ended it, for which its task is not to blame.
    Interrupted,
    /// It died, perhaps of its task.
    Died,
}

impl Engine {
    /// As people write it.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Slurm(_) => "Slurm",
            Self::Kubernetes(_) => "Kubernetes",
        }
    }

    /// The workers of this store, also those that ended lately.
    ///
    /// # Errors
    /// When the engine does not answer, refuses or cannot be understood.
    pub async fn workers(&self) -> Result<Vec<PlacedWorker>, EngineError> {
        match self {
            Self::Slurm(slurm) => slurm.workers().await,
            Self::Kubernetes(kubernetes) => kubernetes.workers().await,
        }
    }

    /// Asks for a worker; says what the engine calls it.
    ///
    /// # Errors
    /// As [`Engine::workers`].
    pub async fn ask(&self, ask: &Ask) -> Result<String, EngineError> {
        match self {
            Self::Slurm(slurm) => slurm.ask(ask).await,
            Self::Kubernetes(kubernetes) => kubernetes.ask(ask).await,
        }
    }

    /// Takes a worker's request back, or has the worker put its task down and end.
    ///
    /// # Errors
    /// As [`Engine::workers`]; a worker that is not there any more is none.
    pub async fn let_go(&self, name: &str, identifier: &str) -> Result<(), EngineError> {
        match self {
            Self::Slurm(slurm) => slurm.let_go(identifier).await,
            Self::Kubernetes(kubernetes) => kubernetes.let_go(name).await,
        }
    }

    /// How a worker ended that the engine shows no more; `None` where it does not remember.
    pub async fn remembers(&self, name: &str) -> Option<End> {
        match self {
            Self::Slurm(slurm) => slurm.remembers(name).await,
            // A Job that was deleted is forgotten.
            Self::Kubernetes(_) => None,
        }
    }
}

//! The engine of a cluster.

use crate::{Ask, End, EngineError, Kubernetes, PlacedWorker, Slurm};

/// The engine that places workers.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "a server has one")]
pub enum Engine {
    /// The commands of Slurm, on the machine of the server.
    Slurm(Slurm),
    /// The API of the cluster that the server runs in or its kubeconfig names.
    Kubernetes(Box<Kubernetes>),
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
    pub(crate) async fn workers(&self) -> Result<Vec<PlacedWorker>, EngineError> {
        match self {
            Self::Slurm(slurm) => slurm.workers().await,
            Self::Kubernetes(kubernetes) => kubernetes.workers().await,
        }
    }

    /// Requests a worker. Returns the engine's name for it.
    ///
    /// # Errors
    /// Like [`Engine::workers`].
    pub(crate) async fn ask(&self, ask: &Ask) -> Result<String, EngineError> {
        match self {
            Self::Slurm(slurm) => slurm.ask(ask).await,
            Self::Kubernetes(kubernetes) => kubernetes.ask(ask).await,
        }
    }

    /// Withdraws a worker's request, or tells the worker to give its task back and end.
    ///
    /// # Errors
    /// Like [`Engine::workers`]. A worker that is already gone is no error.
    pub(crate) async fn let_go(&self, name: &str, identifier: &str) -> Result<(), EngineError> {
        match self {
            Self::Slurm(slurm) => slurm.let_go(identifier).await,
            Self::Kubernetes(kubernetes) => kubernetes.let_go(name).await,
        }
    }

    /// How a worker ended that the engine no longer shows; `None` if the engine does not remember.
    pub(crate) async fn remembers(&self, name: &str) -> Option<End> {
        match self {
            Self::Slurm(slurm) => slurm.remembers(name).await,
            // A Job that was deleted is forgotten.
            Self::Kubernetes(_) => None,
        }
    }
}

//! Who runs the workers. A server starts its own as child processes ([`WorkerProcesses`]), or has a cluster's
//! [`Engine`] place them: Slurm or Kubernetes.
//!
//! [`Control`] looks again and again: what the engine shows of its workers, who has a task, what waits. What to do
//! about it is decided by [`plan`], a function of these. Nothing about workers is remembered that the engine can be
//! asked: their names and labels say whose they are and what they offer, so that the next server finds them.

mod backoff;
mod control;
mod engine;
mod error;
mod kubernetes;
mod local;
mod memory;
mod plan;
mod refusals;
mod resources;
mod slurm;
mod worker_command;

pub use control::{Control, Settings};
pub use engine::{Ask, Cause, End, Engine, Phase, PlacedWorker};
pub use error::EngineError;
pub use kubernetes::{Kubernetes, TemplateError};
pub use local::{GAVE_UP, WorkerProcesses};
pub use plan::{Action, Bounds, KnownWorker, SETTLED_AFTER, WorkerState, plan};
pub use slurm::Slurm;
pub use worker_command::{WorkerCommand, new_name, prefix};

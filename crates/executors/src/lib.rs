//! Runs the workers. A server starts its own workers as child processes ([`WorkerProcesses`]), or
//! has a cluster's [`Engine`] place them: Slurm or Kubernetes.
//!
//! [`Autoscaler`] looks regularly at the engine's workers, at their tasks and at waiting tasks.
//! [`plan`], a pure function of these, decides what to do. Everything about workers that the engine
//! can be asked for is not stored: their names and labels say which store they belong to and what
//! they offer, so the next server finds them.
//!
//! A worker's name is chosen before the request and contains the store's own, so a restarted server
//! finds its workers, and a request whose answer was lost is not repeated. Several servers may
//! share a store; one of them looks. A refusal holds for the refused offer, so a task that no node
//! can do holds up no other. The task of a worker that the scheduler reports as ended is taken
//! back.
//!
//! Local workers are child processes whose standard input the server holds. When the server dies,
//! however it dies, they read the end of it and stop.

#![warn(missing_docs)]

mod autoscaler;
mod backoff;
mod engine;
mod error;
mod kubernetes;
mod local;
mod memory;
mod plan;
mod refusals;
mod request;
mod resources;
mod slurm;
mod worker_command;

pub(crate) use error::EngineError;
pub(crate) use request::{Ask, Cause, End, Phase, PlacedWorker};

pub use autoscaler::{Autoscaler, Settings};
pub use engine::Engine;
pub use kubernetes::{Kubernetes, TemplateError};
pub use local::{GAVE_UP, WorkerProcesses};
pub use plan::{Action, Bounds, KnownWorker, SETTLED_AFTER, WorkerState, plan};
pub use slurm::Slurm;
pub use worker_command::{SERVERS_TOKEN, WorkerCommand, new_name, prefix};

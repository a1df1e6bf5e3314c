//! Executes tasks: claims one, keeps its lease alive, does the science, commits, repeats.
//!
//! One module per job kind turns rows and objects into science and back. They are blocking code on
//! a thread of their own, while heartbeats go on beside them; when told to stop they end at the
//! next point where nothing is lost. Work that does not end when it is told to ends with its process, and the attempt
//! is ended before.

mod attempt;
mod attempt_log;
mod claim_loop;
mod control;
mod dataset;
mod error;
mod evaluate;
mod folder;
mod heartbeat;
mod held_task;
mod import;
mod kinds;
mod presence;
mod probe;
mod rehearsal;
mod simulate;
mod stop;
mod stream;
mod summary;
mod train;
mod trajectories;
mod verify;

pub use attempt_log::{AttemptLog, CurrentAttempt};
pub use claim_loop::{WorkerOptions, run};
pub use error::{RehearsalError, WorkerError};
pub use folder::{DatasetFolder, FolderError, Verified};
pub use models::DeviceKind;
pub use probe::{PROBE_LIMIT, ProbeError, Probed, probe, try_device};
pub use rehearsal::{TrainingTimes, baseline_seconds, simulation_seconds, training_times};

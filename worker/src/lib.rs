//! Executes tasks: claims one, keeps its lease alive, does the science, commits, repeats.
//!
//! There is one module per job kind, which turns rows and objects into science and back. It is
//! blocking code on its own thread, while heartbeats continue. After a stop signal, it ends at the
//! next point where no work is lost. If it does not end in time, the worker ends the attempt, and
//! then its own process.
//!
//! # Stopping
//!
//! Each heartbeat, once a second, says whether the worker may go on. Predictors, laws and reports
//! end within a second of being told to: their loops check `kernels::Interrupt`, and unwind to
//! where the computation began. Work that does not end has a deadline, which depends on the reason
//! (`stop`). After it the worker ends the attempt in the database, under its fence, and then
//! itself, with a code that its parent does not take for a crash. Nothing else ends a thread that
//! waits for a disk.
//!
//! # Logs
//!
//! The log of an attempt has everything that its process logs meanwhile. A process has one task at
//! a time, so lines of all threads belong to it. Writing a line adds it to memory with a limit and
//! waits for nothing. Heartbeats send the lines so far, and the work sends the rest before the
//! transaction that ends the attempt.

#![warn(missing_docs)]

mod attempt;
mod attempt_log;
mod checkpoint;
mod claim_loop;
mod control;
mod dataset;
mod error;
mod evaluate;
mod folder;
mod heartbeat;
mod held_task;
mod identify;
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
pub use error::{ImportRehearsalError, RehearsalError, WorkerError};
pub use folder::{DatasetFolder, FolderError, Verified};
pub use identify::{ArmFile, ArmFileError, FoundLoad, IdentifiedArm};
pub use import::{Rehearsal, RehearsedFile, read_logs, recording_lengths, rehearse};
pub use models::DeviceKind;
pub use probe::{PROBE_LIMIT, ProbeError, Probed, probe, try_device};
pub use rehearsal::{TrainingTimes, baseline_seconds, simulation_seconds, training_times};

//! Why a worker, a task or an estimate ends without a result.

use identification::IdentificationError;
use models::{DeviceKind, Interrupted, ModelError};
use store::{JobId, Retry, StoreError};
use thiserror::Error;

use crate::identify::ArmFileError;
use crate::stop::StopReason;

/// Why a worker cannot go on at all.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "messages say what variants and their fields mean")]
pub enum WorkerError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("cannot start {threads} threads")]
    Threads { threads: usize, source: rayon::ThreadPoolBuildError },
    #[error(transparent)]
    Device(#[from] models::DeviceError),
    /// A driver that failed once is not trusted with the next task.
    #[error("device `{device}` failed; only a new process can use it again")]
    DeviceFailed { device: DeviceKind },
    /// Only the end of this process ends the work. Its attempt has ended already.
    #[error(
        "task {task:?} of job {job} did not end within {} s, although {}; it ends with this process",
        reason.within().as_secs(), reason.as_str()
    )]
    Unstoppable { job: JobId, task: String, reason: StopReason },
}

/// Why the cost of a job cannot be estimated.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "messages say what variants and their fields mean")]
pub enum RehearsalError {
    #[error(transparent)]
    Dynamics(#[from] dynamics::DynamicsError),
    #[error(transparent)]
    Series(#[from] series::ShapeError),
    #[error(transparent)]
    Model(#[from] models::ModelError),
    #[error(transparent)]
    Device(#[from] models::DeviceError),
}

/// Why a file cannot be imported.
#[derive(Debug, Error)]
#[error(transparent)]
pub struct ImportRehearsalError(#[from] TaskError);

/// Why an attempt at a task failed.
#[derive(Debug, Error)]
pub enum TaskError {
    #[error("stopped on request")]
    Stopped,
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Dynamics(#[from] dynamics::DynamicsError),
    #[error(transparent)]
    Model(#[from] models::ModelError),
    /// The training produced numbers that are not finite. The same spec would produce them again.
    #[error(
        "the training diverged at {cause}; the batch was {batch}; {checkpoint}; a smaller \
         learning rate, a longer warmup or optimizer.gradient_clip_norm may help"
    )]
    Diverged { cause: models::ModelError, batch: String, checkpoint: String },
    #[error(transparent)]
    Import(#[from] recordings::ImportError),
    #[error(transparent)]
    Evaluation(#[from] evaluation::EvaluationError),
    #[error(transparent)]
    Identification(IdentificationError),
    #[error(transparent)]
    ArmFile(#[from] ArmFileError),
    #[error("a figure could not be drawn")]
    Figure(#[from] figures::FigureError),
    #[error(transparent)]
    Series(#[from] series::ShapeError),
    #[error("columns could not be arranged")]
    Columns(#[from] arrow_schema::ArrowError),
    #[error("a table could not be written")]
    Table(#[from] csv::Error),
    #[error("the stored spec, a payload or a result cannot be read")]
    Spec(#[from] serde_json::Error),
    /// A stored file differs from what its spec gives, or from what was stored.
    #[error("{0}")]
    Differs(String),
    #[error("the data does not fit the job")]
    Unsuitable(#[from] spec::SpecError),
    #[error("{what} {name} does not exist any more")]
    Missing { what: &'static str, name: String },
    #[error("this version cannot execute tasks of jobs of kind {kind}")]
    UnknownKind { kind: String },
    #[error("cannot start a thread")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    #[error("{0}")]
    Panicked(String),
    /// The device is out of memory, or its driver failed. burn panics in both cases.
    #[error("device `{device}` failed, perhaps for lack of memory: {message}")]
    Device { device: DeviceKind, message: String },
}

impl From<Interrupted> for TaskError {
    fn from(_: Interrupted) -> Self {
        Self::Stopped
    }
}

impl From<IdentificationError> for TaskError {
    fn from(error: IdentificationError) -> Self {
        match error {
            IdentificationError::Stopped => Self::Stopped,
            error => Self::Identification(error),
        }
    }
}

impl TaskError {
    /// Whether another attempt could succeed. That is so only for failures of the disk, the
    /// database or the device.
    pub fn retry(&self) -> Retry {
        match self {
            Self::Import(error) if error.may_pass() => Retry::Allowed,
            // Damage is permanent.
            Self::Store(StoreError::DamagedObject { .. }) => Retry::Never,
            Self::Store(_)
            | Self::Threads(_)
            | Self::Stopped
            | Self::Device { .. }
            | Self::Model(ModelError::Device(_)) => Retry::Allowed,
            Self::Dynamics(_)
            | Self::Model(_)
            | Self::Diverged { .. }
            | Self::Evaluation(_)
            | Self::Import(_)
            | Self::Identification(_)
            | Self::ArmFile(_)
            | Self::Figure(_)
            | Self::Series(_)
            | Self::Columns(_)
            | Self::Table(_)
            | Self::Spec(_)
            | Self::Missing { .. }
            | Self::Differs(_)
            | Self::UnknownKind { .. }
            | Self::Unsuitable(_)
            | Self::Panicked(_) => Retry::Never,
        }
    }

    /// Whether the disk had no room for the results, or the place of the files is not there.
    pub fn is_without_room(&self) -> bool {
        match self {
            // It is transparent: its source is that of the error in it.
            Self::Store(error) => StoreError::is_without_room(error),
            error => StoreError::is_without_room(error),
        }
    }

    /// Whether the device may be at fault.
    pub fn is_of_device(&self) -> bool {
        matches!(self, Self::Device { .. } | Self::Model(ModelError::Device(_)))
    }
}

use std::future::Future;
use std::ops::ControlFlow;
use std::sync::Arc;

use models::Device;
use recordings::DecoderProgram;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use store::{ClaimedTask, Fence, NewArtifact, Store, StoreError};
use tokio::runtime::Handle;

use crate::attempt_log::AttemptLog;
use crate::error::TaskError;
use crate::heartbeat::ProgressCell;
use crate::stop::StopSignal;

/// One attempt at a task, with everything that the work needs on its thread.
pub(crate) struct Attempt {
    pub store: Store,
    /// The device that computes models.
    pub device: Device,
    /// The program that decodes files of other formats.
    pub decoder: DecoderProgram,
    pub task: ClaimedTask,
    pub progress: Arc<ProgressCell>,
    pub log: AttemptLog,
    pub stop: Arc<StopSignal>,
    pub runtime: Handle,
}

impl Attempt {
    pub fn fence(&self) -> Fence {
        self.task.fence
    }

    /// Blocks on a future. The store is asynchronous, and the work is not.
    pub fn wait<T>(&self, future: impl Future<Output = T>) -> T {
        self.runtime.block_on(future)
    }

    /// # Errors
    /// [`TaskError::Stopped`] when the attempt has to end.
    pub fn check_stop(&self) -> Result<(), TaskError> {
        match self.stop.get() {
            Some(_) => Err(TaskError::Stopped),
            None => Ok(()),
        }
    }

    /// Does `work` unless the attempt has to end. Kernels, baselines and dynamics look for an
    /// interrupt and leave the work halfway. The result of interrupted work is never used, whatever
    /// it looks like.
    ///
    /// # Errors
    /// [`TaskError::Stopped`] when the attempt has to end.
    pub fn interruptible<T>(&self, work: impl FnOnce() -> T) -> Result<T, TaskError> {
        self.check_stop()?;
        let done = self.stop.interrupt().guard(|| Ok::<T, TaskError>(work()))?;
        self.check_stop()?;
        Ok(done)
    }

    /// Reports progress. Breaks when the attempt has to end.
    pub fn show(&self, done: u64) -> ControlFlow<()> {
        self.progress.set_done(done);
        match self.stop.get() {
            Some(_) => ControlFlow::Break(()),
            None => ControlFlow::Continue(()),
        }
    }

    /// Reads the task's payload: its part of the job, as the job's planner wrote it.
    pub fn payload<T: DeserializeOwned>(&self) -> Result<T, TaskError> {
        Ok(serde_json::from_value(self.task.payload.clone())?)
    }

    /// Stores a file in the job's run.
    pub fn put(&self, name: &str, media_type: &str, bytes: Vec<u8>) -> Result<(), TaskError> {
        let artifact = NewArtifact { name, media_type, bytes: bytes.into() };
        self.wait(self.store.put_artifact(self.fence(), artifact))?;
        Ok(())
    }

    /// Completes the task with its result.
    pub fn complete(&self, result: &impl Serialize) -> Result<(), TaskError> {
        let result = serde_json::to_value(result)?;
        self.end(self.store.complete(self.fence(), Some(&result)))
    }

    /// Ends the task by `commit`. The log is sent first, because nothing can be added to it
    /// afterwards.
    pub fn end<T>(
        &self,
        commit: impl Future<Output = Result<T, StoreError>>,
    ) -> Result<(), TaskError> {
        tracing::info!(seconds = self.progress.seconds(), "done");
        if let Err(error) = self.wait(self.log.send(&self.store, self.fence())) {
            tracing::warn!(error = spec::causes(&error), "cannot write the end of the log");
        }
        self.wait(commit)?;
        Ok(())
    }

    /// Reads the job's stored spec, which carries its kind as a tag.
    pub fn spec<T: DeserializeOwned>(&self) -> Result<T, TaskError> {
        read_spec(&self.task.spec)
    }
}

/// Reads a stored spec of a known kind. It was validated when the job was submitted.
pub(crate) fn read_spec<T: DeserializeOwned>(spec: &Value) -> Result<T, TaskError> {
    let mut fields = spec.clone();
    if let Some(fields) = fields.as_object_mut() {
        fields.remove("kind");
    }
    Ok(serde_json::from_value(fields)?)
}

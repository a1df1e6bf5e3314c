//! Predictions for waiting clients: models that stay loaded, and the threads that compute.
//!
//! A question, or a step of a stream, is computed in the server and never queued as a job. A model
//! is loaded once for any number of askers, and stays while there is room or a stream holds it.
//! Questions and streams each have a queue and a pool of threads, with one prediction at a time. A
//! panic fails that prediction alone, and a dropped request interrupts it.

#![warn(missing_docs)]

mod cache;
mod loaded;
mod queues;

use std::num::NonZero;
use std::sync::Arc;

use api::live::{LiveError, LiveModel, LiveModels};
use futures::FutureExt;
use futures::future::BoxFuture;
use models::{CONFIG_FILE, Device, DeviceKind, MODEL_FILE, TrainedModel};
use store::{Checkpoint, Store, StoredObject};
use tokio::sync::{OnceCell, Semaphore};

use cache::{Cache, Capacity};
use loaded::Loaded;
use queues::LiveQueues;

/// Number of models that are kept loaded.
const LOADED_MODELS: usize = 8;

/// Default limit of the weights that are kept loaded, in bytes.
pub const LOADED_BYTES: u64 = 2 << 30;

/// Where predictions are computed, and what they may take.
#[derive(Clone, Debug)]
pub struct Options {
    /// The device of all loaded models.
    pub device: DeviceKind,
    /// Number of threads that compute one prediction.
    pub threads: NonZero<usize>,
    /// Limit of the weights of all loaded models together, in bytes.
    pub loaded_bytes: u64,
}

/// Predicts with the checkpoints of a store.
pub struct Live {
    store: Store,
    options: Options,
    /// Opened when it is first needed.
    device: OnceCell<Device>,
    queues: Arc<LiveQueues>,
    models: Cache<[spec::Digest; 2], Loaded>,
    /// Only one model is loaded at a time, because loading takes several times its size in memory.
    loading: Semaphore,
}

impl Live {
    /// Starts the threads. Models are loaded when they are first asked.
    ///
    /// # Errors
    /// When the system cannot start the threads.
    pub fn new(store: Store, options: Options) -> Result<Self, rayon::ThreadPoolBuildError> {
        let queues = Arc::new(LiveQueues::new(options.threads)?);
        let capacity = Capacity { count: LOADED_MODELS, bytes: options.loaded_bytes };
        Ok(Self {
            store,
            options,
            device: OnceCell::new(),
            queues,
            models: Cache::new(capacity),
            loading: Semaphore::new(1),
        })
    }

    async fn device(&self) -> Result<Device, LiveError> {
        let kind = self.options.device;
        let open = || async move {
            let opened = tokio::task::spawn_blocking(move || Device::open(kind)).await;
            let opened = opened.map_err(|panic| panic.to_string())?;
            opened.map_err(|error| error.to_string())
        };
        let unusable = |reason: String| LiveError::Unusable { reason };
        self.device.get_or_try_init(open).await.cloned().map_err(unusable)
    }

    async fn read(
        &self,
        weights: &StoredObject,
        config: &StoredObject,
    ) -> Result<Loaded, LiveError> {
        let _place = self.loading.acquire().await;
        let device = self.device().await?;
        let size = weights.size;
        let (weights, config) =
            (self.store.read_object(weights).await?, self.store.read_object(config).await?);
        let read = move || TrainedModel::load(&weights, &config, &device);
        let unusable = |reason: String| LiveError::Unusable { reason };
        let model = tokio::task::spawn_blocking(read)
            .await
            .map_err(|panic| unusable(panic.to_string()))?
            .map_err(|error| unusable(error.to_string()))?;
        Ok(Loaded::new(model, size, self.options.device, Arc::clone(&self.queues)))
    }
}

impl LiveModels for Live {
    fn load<'a>(
        &'a self,
        checkpoint: &'a Checkpoint,
    ) -> BoxFuture<'a, Result<Arc<dyn LiveModel>, LiveError>> {
        async move {
            let file = |name| {
                let reason = format!("checkpoint {} has no {name}", checkpoint.id.0);
                checkpoint.file(name).ok_or(LiveError::Unusable { reason })
            };
            let (weights, config) = (file(MODEL_FILE)?, file(CONFIG_FILE)?);
            // The key is not the id, because a checkpoint may be written again under the same id.
            let key = [weights.sha256, config.sha256];
            let load = || self.read(weights, config);
            let model = self.models.get(key, weights.size, load).await?;
            Ok(model as Arc<dyn LiveModel>)
        }
        .boxed()
    }
}

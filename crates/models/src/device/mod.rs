//! The device that stores tensors and computes them. It is chosen at run time among those that the
//! program was built with.
//!
//! A device belongs to a machine and is not part of a spec. Results on another device differ only
//! by rounding.

mod check;
#[cfg(feature = "gpu")]
mod gpu;
mod kind;
#[cfg(feature = "torch")]
mod torch;

use burn::tensor::Tensor;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::ModelError;
use crate::single_threads::on_one_thread;

pub use kind::DeviceKind;

/// An opened device. Clones share it.
#[derive(Clone, Debug)]
pub struct Device {
    tensors: burn::tensor::Device,
    kind: DeviceKind,
    description: DeviceDescription,
}

/// A description of the device, for people and for checkpoints.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct DeviceDescription {
    /// The name from [`DeviceKind::name`].
    pub name: String,
    /// The crate that computes.
    pub backend: String,
    /// The hardware, by the name that its driver gives. It is empty for a processor, because
    /// results do not depend on which processor computes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub adapter: Option<String>,
    /// Name and version of the driver.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub driver: Option<String>,
    /// Whether the adapter is software that emulates a GPU on the processor.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_software: bool,
}

/// The tensor's values in row-major order.
pub(crate) fn host_values<const D: usize>(tensor: Tensor<D>) -> Result<Vec<f32>, ModelError> {
    tensor.try_into_vec_as::<f32>().map_err(|error| ModelError::Device(error.to_string()))
}

/// Why a device cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[expect(missing_docs, reason = "messages say what variants and their fields mean")]
pub enum DeviceError {
    #[error("unknown device `{name}`, allowed: {}", built())]
    Unknown { name: String },

    #[error(
        "this program was built without device `{kind}`, allowed: {}; build it with \
         `--features {}`",
        built(), kind.feature().unwrap_or_default()
    )]
    NotBuilt { kind: DeviceKind },

    #[error("device `{kind}` cannot be opened: {reason}")]
    Unavailable { kind: DeviceKind, reason: String },

    #[error("device `{kind}` computes wrongly: {what} is {found}, expected {expected}")]
    Wrong { kind: DeviceKind, what: &'static str, found: String, expected: String },
}

/// Names of the devices that this program was built with.
fn built() -> String {
    let names: Vec<&str> = DeviceKind::built().map(DeviceKind::name).collect();
    names.join(", ")
}

impl Device {
    /// The processor, through burn's `flex` backend. Our own operations use all threads of rayon's pool.
    pub fn cpu() -> Self {
        Self::plain(DeviceKind::Cpu, burn::tensor::Device::flex())
    }

    /// Opens a device. Some drivers have crashed or hung here. Where the process must survive that,
    /// open the device in another process first.
    ///
    /// # Errors
    /// The program was built without the device, or no driver for it works.
    pub fn open(kind: DeviceKind) -> Result<Self, DeviceError> {
        match kind {
            DeviceKind::Cpu => Ok(Self::cpu()),
            #[cfg(feature = "gpu")]
            DeviceKind::Gpu => gpu::open(),
            #[cfg(feature = "cuda")]
            DeviceKind::Cuda => Ok(cuda()),
            #[cfg(feature = "ndarray")]
            #[expect(deprecated, reason = "burn keeps it for one more release; it is a reference")]
            DeviceKind::NdArray => Ok(Self::plain(kind, burn::tensor::Device::ndarray())),
            #[cfg(feature = "torch")]
            DeviceKind::Torch | DeviceKind::TorchTf32 => Ok(torch::open(kind)),
            #[cfg(not(all(
                feature = "gpu",
                feature = "cuda",
                feature = "ndarray",
                feature = "torch"
            )))]
            _ => Err(DeviceError::NotBuilt { kind }),
        }
    }

    /// The kind of this device.
    pub fn kind(&self) -> DeviceKind {
        self.kind
    }

    /// The backend, the hardware and the driver of this device.
    pub fn description(&self) -> &DeviceDescription {
        &self.description
    }

    /// Computes an answer on the thread that serves this device best. For the processor that is one of the pool: from any
    /// other, each of hundreds of parallel loops would wake a thread of the pool and wait for it.
    pub(crate) fn answer<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        if self.kind.keeps_plans_by_thread() {
            on_one_thread(0, work)
        } else {
            rayon::scope(|_| work())
        }
    }

    /// Computes a part of a training, whose parts all come from the same thread.
    pub(crate) fn train<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        if self.kind.keeps_plans_by_thread() { work() } else { self.answer(work) }
    }

    /// A device that computes values only.
    pub(crate) fn inference(&self) -> burn::tensor::Device {
        self.tensors.clone()
    }

    /// A device that also records what the backward pass needs.
    pub(crate) fn training(&self) -> burn::tensor::Device {
        self.tensors.clone().autodiff()
    }

    fn plain(kind: DeviceKind, tensors: burn::tensor::Device) -> Self {
        let description = DeviceDescription {
            name: kind.name().to_owned(),
            backend: kind.backend().to_owned(),
            adapter: None,
            driver: None,
            is_software: false,
        };
        Self { tensors, kind, description }
    }
}

/// The GPU that CUDA lists first. burn panics if it cannot be opened.
#[cfg(feature = "cuda")]
fn cuda() -> Device {
    let tensors = burn::tensor::Device::cuda(burn::tensor::DeviceIndex::Default);
    let adapter = tensors.identity().map(|identity| identity.name);
    let mut device = Device::plain(DeviceKind::Cuda, tensors);
    device.description.adapter = adapter;
    device
}

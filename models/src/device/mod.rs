//! Where tensors live and are computed: chosen at run time among what the program was built with.
//!
//! A device belongs to a machine, not to a spec: results on another one differ in rounding only.

mod check;
#[cfg(feature = "gpu")]
mod gpu;
mod kind;

use burn::tensor::Tensor;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::ModelError;

pub use kind::DeviceKind;

/// An opened device. Clones are the same one.
#[derive(Clone, Debug)]
pub struct Device {
    tensors: burn::tensor::Device,
    kind: DeviceKind,
    description: DeviceDescription,
}

/// What computes, for people to read and for checkpoints to keep.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct DeviceDescription {
    /// As [`DeviceKind::name`].
    pub name: String,
    /// The crate that computes.
    pub backend: String,
    /// The hardware, as its driver calls it. A processor does not show: results do not depend on
    /// which one it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub adapter: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub driver: Option<String>,
    /// Whether the adapter is a program that computes on the processor what a GPU would.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_software: bool,
}

/// The tensor's values in row-major order.
pub(crate) fn host_values<const D: usize>(tensor: Tensor<D>) -> Result<Vec<f32>, ModelError> {
    tensor.try_into_vec_as::<f32>().map_err(|error| ModelError::Device(error.to_string()))
}

/// Why a device cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum DeviceError {
    #[error("there is no device `{name}`, this program has {}", built())]
    Unknown { name: String },

    #[error(
        "this program was built without device `{kind}`: build it with `--features {kind}`; it has {}",
        built()
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
    /// The processor, through burn's `flex` backend. As many threads as rayon has.
    pub fn cpu() -> Self {
        Self::plain(DeviceKind::Cpu, burn::tensor::Device::flex())
    }

    /// Opens a device. Drivers have crashed and hung at this: where that must not take the process
    /// along, it is tried in another one first.
    ///
    /// # Errors
    /// A device that the program was built without, or without a driver that works.
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
            #[cfg(not(all(feature = "gpu", feature = "cuda", feature = "ndarray")))]
            _ => Err(DeviceError::NotBuilt { kind }),
        }
    }

    pub fn kind(&self) -> DeviceKind {
        self.kind
    }

    pub fn description(&self) -> &DeviceDescription {
        &self.description
    }

    /// Computes values only.
    pub(crate) fn inference(&self) -> burn::tensor::Device {
        self.tensors.clone()
    }

    /// Computes values and records what their gradients need.
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

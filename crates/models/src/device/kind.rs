//! The kinds of devices.

use std::fmt::{self, Display};
use std::str::FromStr;

use super::DeviceError;

/// The kinds of devices that compute models.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeviceKind {
    /// The processor, with burn-flex and the fused operations of [`crate`].
    #[default]
    Cpu,
    /// A GPU through Vulkan, with burn-wgpu.
    Gpu,
    /// A GPU of NVIDIA through CUDA, with burn-cuda.
    Cuda,
    /// The processor, with burn-ndarray: slow and plain.
    NdArray,
    /// A GPU of NVIDIA, or else the processor, through PyTorch's libraries.
    Torch,
    /// The same with products and convolutions that round their factors to TF32.
    TorchTf32,
}

impl DeviceKind {
    /// All kinds.
    pub const ALL: [Self; 6] =
        [Self::Cpu, Self::Gpu, Self::Cuda, Self::NdArray, Self::Torch, Self::TorchTf32];

    /// The kinds that this program was built with.
    pub fn built() -> impl Iterator<Item = Self> {
        Self::ALL.into_iter().filter(|kind| kind.is_built())
    }

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Gpu => "gpu",
            Self::Cuda => "cuda",
            Self::NdArray => "ndarray",
            Self::Torch => "torch",
            Self::TorchTf32 => "torch-tf32",
        }
    }

    /// The cargo feature that adds this kind, or `None` for the kind that every build has.
    pub fn feature(self) -> Option<&'static str> {
        match self {
            Self::Cpu => None,
            Self::Gpu | Self::Cuda | Self::NdArray => Some(self.name()),
            Self::Torch | Self::TorchTf32 => Some("torch"),
        }
    }

    /// Whether this program was built with support for it.
    pub fn is_built(self) -> bool {
        match self {
            Self::Cpu => true,
            Self::Gpu => cfg!(feature = "gpu"),
            Self::Cuda => cfg!(feature = "cuda"),
            Self::NdArray => cfg!(feature = "ndarray"),
            Self::Torch | Self::TorchTf32 => cfg!(feature = "torch"),
        }
    }

    /// Whether tensors lie in a separate memory behind a driver. Reading one back then waits for
    /// all computations before it.
    pub fn is_apart(self) -> bool {
        match self {
            Self::Cpu | Self::NdArray => false,
            Self::Gpu | Self::Cuda | Self::Torch | Self::TorchTf32 => true,
        }
    }

    /// Whether the library keeps what it chose for an operation, such as the plan of a convolution, for each thread apart.
    pub fn keeps_plans_by_thread(self) -> bool {
        match self {
            Self::Cpu | Self::Gpu | Self::Cuda | Self::NdArray => false,
            Self::Torch | Self::TorchTf32 => true,
        }
    }

    /// The crate that computes on this kind.
    pub fn backend(self) -> &'static str {
        match self {
            Self::Cpu => "burn-flex",
            Self::Gpu => "burn-wgpu",
            Self::Cuda => "burn-cuda",
            Self::NdArray => "burn-ndarray",
            Self::Torch | Self::TorchTf32 => "burn-tch",
        }
    }
}

impl Display for DeviceKind {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}

impl FromStr for DeviceKind {
    type Err = DeviceError;

    /// # Errors
    /// No device has this name, or this program was built without it.
    fn from_str(name: &str) -> Result<Self, DeviceError> {
        match Self::ALL.into_iter().find(|kind| kind.name() == name) {
            None => Err(DeviceError::Unknown { name: name.to_owned() }),
            Some(kind) if kind.is_built() => Ok(kind),
            Some(kind) => Err(DeviceError::NotBuilt { kind }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_device_is_taken_by_its_name_or_answered_with_the_feature_that_has_it() {
        for kind in DeviceKind::ALL {
            match (kind.name().parse::<DeviceKind>(), kind.is_built()) {
                (Ok(parsed), true) => assert_eq!(parsed, kind),
                (Err(error), false) => {
                    let named = format!("--features {}", kind.feature().unwrap());
                    assert!(error.to_string().contains(&named), "{error}");
                }
                (parsed, is_built) => panic!("{parsed:?}, {is_built}"),
            }
        }
    }

    #[test]
    fn a_name_that_is_no_devices_is_answered_with_those_that_are() {
        for name in ["", "GPU", "tpu", "cpu "] {
            let message = name.parse::<DeviceKind>().unwrap_err().to_string();
            assert!(message.contains(&format!("device `{name}`")), "{message}");
            assert!(message.contains("cpu"), "{message}");
        }
    }
}

//! The GPU that PyTorch's libraries open.

use burn::tensor::DeviceIndex;

use super::{Device, DeviceDescription, DeviceKind};

/// The first GPU, or the processor if there is none. How products are rounded is chosen for the whole process.
#[expect(deprecated, reason = "burn will remove burn-tch in a later release")]
pub(super) fn open(kind: DeviceKind) -> Device {
    kernels::torch::configure(kind == DeviceKind::TorchTf32);
    let has_gpu = tch::Cuda::is_available();
    let tensors = if has_gpu {
        burn::tensor::Device::libtorch_cuda(DeviceIndex::Default)
    } else {
        burn::tensor::Device::libtorch()
    };
    let gpu = if has_gpu { kernels::torch::gpu() } else { None };
    let (adapter, cuda) = gpu.unzip();
    let cuda = cuda.map_or(String::new(), |version| format!(", CUDA {version}"));
    let description = DeviceDescription {
        name: kind.name().to_owned(),
        backend: kind.backend().to_owned(),
        adapter,
        driver: Some(format!("PyTorch {}{cuda}", kernels::torch::version())),
        is_software: !has_gpu,
    };
    Device { tensors, kind, description }
}

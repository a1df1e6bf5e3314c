//! The adapter that a GPU backend opens.

use std::sync::OnceLock;

use burn::tensor::wgpu::{WgpuBackend, WgpuInitError, wgpu};

use super::{Device, DeviceDescription, DeviceError, DeviceKind};

const KIND: DeviceKind = DeviceKind::Gpu;

/// The best GPU that Vulkan has, or the one that `CUBECL_WGPU_DEFAULT_DEVICE` names.
pub(super) fn open() -> Result<Device, DeviceError> {
    // burn opens a GPU once in a process and refuses a second time.
    static OPENED: OnceLock<Result<Device, DeviceError>> = OnceLock::new();
    OPENED.get_or_init(open_first).clone()
}

fn open_first() -> Result<Device, DeviceError> {
    // burn's other constructors panic where there is no driver.
    let (tensors, setup) = burn::tensor::Device::wgpu_options()
        .graphics_api(WgpuBackend::Vulkan)
        .init_with_setup()
        .map_err(|error| DeviceError::Unavailable { kind: KIND, reason: reason(error) })?;
    let adapter = setup.adapter.get_info();
    let driver = format!("{} {}", adapter.driver, adapter.driver_info);
    let description = DeviceDescription {
        name: KIND.name().to_owned(),
        backend: KIND.backend().to_owned(),
        adapter: Some(adapter.name),
        driver: Some(driver.trim().to_owned()),
        is_software: adapter.device_type == wgpu::DeviceType::Cpu,
    };
    Ok(Device { tensors, kind: KIND, description })
}

fn reason(error: WgpuInitError) -> String {
    match error {
        WgpuInitError::AdapterUnavailable { message, .. } => {
            format!("{message}; is a Vulkan driver installed (in Debian: mesa-vulkan-drivers)?")
        }
        other => other.to_string(),
    }
}

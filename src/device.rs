//! Tests devices in a child process of this program, because a driver may crash it.

use tokio::process::Command;
use worker::{DeviceKind, PROBE_LIMIT, ProbeError, Probed};

use crate::process::own_program;

/// Tests a device in a child process.
///
/// # Errors
/// One line that says why the device cannot be used.
pub async fn probe(kind: DeviceKind) -> Result<Probed, ProbeError> {
    let program = own_program().map_err(|source| ProbeError::Spawn { kind, source })?;
    let mut child = Command::new(program);
    child.args(["devices", kind.name(), "--in-this-process"]);
    child.env_remove(executors::SERVERS_TOKEN);
    worker::probe(kind, child, PROBE_LIMIT).await
}

/// Tests a device before work begins on it, and logs its name. Returns the number of GPUs: 0 or 1.
/// The processor is not tested, because it needs no driver.
///
/// # Errors
/// Like [`probe`].
pub async fn require(kind: DeviceKind) -> Result<u32, ProbeError> {
    if !kind.is_apart() {
        return Ok(0);
    }
    let Probed { device, seconds } = probe(kind).await?;
    let adapter = device.adapter.unwrap_or_default();
    let driver = device.driver.unwrap_or_default();
    if device.is_software {
        tracing::warn!(%kind, adapter, driver, "a program on the processor, not a GPU: slow");
    } else {
        tracing::info!(%kind, adapter, driver, seconds, "device works");
    }
    Ok(u32::from(!device.is_software))
}

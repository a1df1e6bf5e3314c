//! Trying devices: this program started once more, as the child that a driver may take along.

use tokio::process::Command;
use worker::{DeviceKind, PROBE_LIMIT, ProbeError, Probed};

use crate::process::own_program;

/// Has a child process try a device.
///
/// # Errors
/// One line that says why the device is not to be used.
pub async fn probe(kind: DeviceKind) -> Result<Probed, ProbeError> {
    let program = own_program().map_err(|source| ProbeError::Spawn { kind, source })?;
    let mut child = Command::new(program);
    child.args(["devices", kind.name(), "--in-this-process"]);
    worker::probe(kind, child, PROBE_LIMIT).await
}

/// Makes sure of a device before work is begun on it, logs what it is, and returns how many GPUs it is: 0 or 1. The
/// processor needs no driver, and is not tried.
///
/// # Errors
/// As [`probe`].
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

//! Python environments, each with the packages of one file of requirements.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::places::repository;
use crate::process::{command, succeed};

/// The Python of the environment in `folder` with these requirements. It is created or updated if
/// necessary.
pub fn environment(folder: &Path, requirements: &str) -> anyhow::Result<PathBuf> {
    let python = folder.join("bin/python");
    let wanted = fs::read_to_string(repository().join(requirements))?;
    let installed = folder.join("installed-requirements.txt");
    if fs::read_to_string(&installed).is_ok_and(|installed| installed == wanted) {
        return Ok(python);
    }
    if !python.is_file() {
        succeed(Command::new("python3").args(["-m", "venv"]).arg(folder))?;
    }
    let pip = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--requirement"];
    succeed(command(&python.to_string_lossy(), &pip).arg(requirements))?;
    fs::write(&installed, wanted)?;
    Ok(python)
}

//! The wheel: the program and the Python modules, packed by maturin.

use std::path::{Path, PathBuf};

use anyhow::Context;

use crate::places::target;
use crate::process::{command, succeed};
use crate::python;

/// Writes the wheel into `folder`. maturin asks cargo for the existing build, with the same
/// program, profile and features. The copy in the wheel loses its debug information, which is half
/// of it.
pub fn build(folder: &Path) -> anyhow::Result<()> {
    let tools = target().join("dist-tools");
    let python = python::environment(&tools, REQUIREMENTS)?;
    let maturin = python.with_file_name("maturin").to_string_lossy().into_owned();
    let made = tempfile::Builder::new().prefix("wheel-").tempdir_in(&tools)?;
    // Compression and dates follow below. With SOURCE_DATE_EPOCH, cargo would compile all C code
    // again.
    let arguments = ["build", "--release", "--locked", "--compression-method", "stored", "--out"];
    succeed(command(&maturin, &arguments).arg(made.path()))?;

    let wheel = only(made.path())?;
    let unpacked = made.path().join("unpacked");
    let with_wheel = |verb: &str| command(&python.to_string_lossy(), &["-m", "wheel", verb]);
    succeed(with_wheel("unpack").arg("--dest").arg(&unpacked).arg(wheel))?;
    let contents = only(&unpacked)?;
    let name = contents.file_name().unwrap_or_default().to_string_lossy();
    let program = contents.join(format!("{name}.data/scripts/torqued"));
    succeed(command("strip", &["--strip-debug"]).arg(program))?;
    succeed(super::dated(with_wheel("pack").arg("--dest-dir").arg(folder).arg(&contents)))
}

const REQUIREMENTS: &str = "deploy/wheel/requirements.txt";

/// The only entry of a folder.
fn only(folder: &Path) -> anyhow::Result<PathBuf> {
    let entry = std::fs::read_dir(folder)?.next();
    Ok(entry.with_context(|| format!("nothing is in {}", folder.display()))??.path())
}

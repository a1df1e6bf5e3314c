//! The package for Debian. cargo-deb builds it from the root manifest.

use std::path::Path;

use crate::process::{self, command, succeed};

/// Writes the package into `folder`.
pub fn build(folder: &Path) -> anyhow::Result<()> {
    if !process::exists("cargo-deb") {
        install()?;
    }
    // The slower compression would take minutes and save a few megabytes.
    let arguments = ["deb", "--no-build", "--locked", "--strip", "--fast", "--output"];
    let mut build = command("cargo", &arguments);
    succeed(super::dated(build.arg(folder)))
}

fn install() -> anyhow::Result<()> {
    // Built without optimisation and with the system's xz, it takes a minute on two cores.
    let lean = ["--locked", "--debug", "--no-default-features"];
    let mut install = command("cargo", &[&["install"], &lean[..], &["cargo-deb@3.8.0"]].concat());
    succeed(install.env("CARGO_PROFILE_DEV_DEBUG", "0").env("CARGO_INCREMENTAL", "0"))
}

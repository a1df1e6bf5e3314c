//! The package for Debian, put together by cargo-deb as the root manifest says.

use std::path::Path;

use crate::process::{self, command, succeed};

/// Writes the package into `folder`.
pub fn build(folder: &Path) -> anyhow::Result<()> {
    if !process::exists("cargo-deb") {
        install()?;
    }
    // The slower compression takes minutes for a few megabytes less.
    let arguments = ["deb", "--no-build", "--locked", "--strip", "--fast", "--output"];
    let mut build = command("cargo", &arguments);
    succeed(super::dated(build.arg(folder)))
}

fn install() -> anyhow::Result<()> {
    // Without optimisation, and with the system's xz: a minute on two cores.
    let lean = ["--locked", "--debug", "--no-default-features"];
    let mut install = command("cargo", &[&["install"], &lean[..], &["cargo-deb@3.8.0"]].concat());
    succeed(install.env("CARGO_PROFILE_DEV_DEBUG", "0").env("CARGO_INCREMENTAL", "0"))
}

//! Installs packages that the tests need and a fresh machine lacks.

use std::fs;
use std::process::Command;

use crate::peers;
use crate::places::repository;
use crate::process::{self, command, succeed};

/// The interpreter of the environment for the tests of readers.
pub const PYTHON: &str = ".venv/bin/python";

pub struct Installation {
    pub name: &'static str,
    pub run: fn() -> anyhow::Result<()>,
}

pub const NEXTEST: Installation = Installation { name: "install cargo-nextest", run: nextest };

pub const ALL: [Installation; 4] = [
    Installation { name: "install system packages", run: system_packages },
    Installation { name: "install Slurm", run: slurm },
    Installation { name: "install Python packages", run: python_packages },
    Installation { name: "install Node packages", run: node_packages },
];

/// For the device tests.
pub const FOR_DEVICES: [Installation; 2] = [
    Installation { name: "install a Vulkan driver", run: software_vulkan },
    Installation { name: "install PyTorch", run: || peers::pytorch_libraries().map(drop) },
];

/// The program that shows that a package is installed, and the package's name in Debian.
const SYSTEM: [(&str, &str); 7] = [
    ("chromium", "chromium"),
    ("curl", "curl"),
    ("node", "nodejs"),
    ("npm", "npm"),
    ("python3", "python3"),
    // A pooler of connections to PostgreSQL. It is in /usr/sbin.
    ("pgbouncer", "pgbouncer"),
    // It emulates a processor with only the baseline of x86-64.
    ("qemu-x86_64", "qemu-user"),
];

fn system_packages() -> anyhow::Result<()> {
    let mut missing: Vec<&str> = SYSTEM
        .iter()
        .filter(|(program, _)| !process::exists(program))
        .map(|(_, package)| *package)
        .collect();
    let venv = Command::new("python3").args(["-c", "import ensurepip"]).output();
    if !venv.is_ok_and(|output| output.status.success()) {
        missing.push("python3-venv");
    }
    if !has_postgresql() {
        missing.push("postgresql");
    }
    debian_packages(&missing)
}

/// Whether the server's programs are installed. Debian keeps them outside of PATH. Tests start
/// their own clusters.
pub fn has_postgresql() -> bool {
    let versions = fs::read_dir("/usr/lib/postgresql").into_iter().flatten().flatten();
    versions.into_iter().any(|version| version.path().join("bin/initdb").exists())
}

/// For the tests of `--executor slurm`. They report that they are skipped where Slurm is not
/// available. The tests start their own daemons.
fn slurm() -> anyhow::Result<()> {
    let missing = if process::exists("sbatch") { &[][..] } else { &["munge", "slurm-wlm"] };
    if let Err(error) = debian_packages(missing) {
        eprintln!("without Slurm: {error:#}");
    }
    Ok(())
}

/// A Vulkan driver that computes on the processor.
fn software_vulkan() -> anyhow::Result<()> {
    let missing = if has_software_vulkan() { &[][..] } else { &["mesa-vulkan-drivers"] };
    debian_packages(missing)
}

fn debian_packages(missing: &[&str]) -> anyhow::Result<()> {
    if missing.is_empty() {
        eprintln!("all there");
        return Ok(());
    }
    apt_get(&["update", "--quiet"])?;
    let mut arguments = vec!["install", "--yes", "--quiet", "--no-install-recommends"];
    arguments.extend(missing);
    apt_get(&arguments)
}

/// Whether Mesa's software driver for Vulkan is installed, which the device tests use where there
/// is no GPU. It is a library. Files in these folders name the drivers.
fn has_software_vulkan() -> bool {
    let folders = ["/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d"];
    let drivers = folders.iter().filter_map(|folder| fs::read_dir(folder).ok()).flatten().flatten();
    drivers.into_iter().any(|driver| driver.file_name().to_string_lossy().starts_with("lvp_icd"))
}

fn apt_get(arguments: &[&str]) -> anyhow::Result<()> {
    let root = Command::new("id").arg("-u").output().is_ok_and(|id| id.stdout == b"0\n");
    let mut apt_get = if root {
        command("apt-get", arguments)
    } else {
        command("sudo", &[&["apt-get"], arguments].concat())
    };
    succeed(apt_get.env("DEBIAN_FRONTEND", "noninteractive"))
}

fn nextest() -> anyhow::Result<()> {
    if process::exists("cargo-nextest") {
        eprintln!("there already");
        return Ok(());
    }
    // Built without optimisation and without the updater, it takes 2 minutes on two cores.
    let lean = ["--debug", "--no-default-features", "--features", "default-no-update"];
    let install = [&["install", "--locked"], &lean[..], &["cargo-nextest"]].concat();
    let mut install = command("cargo", &install);
    succeed(install.env("CARGO_PROFILE_DEV_DEBUG", "0").env("CARGO_INCREMENTAL", "0"))
}

fn python_packages() -> anyhow::Result<()> {
    if !repository().join(PYTHON).is_file() {
        succeed(&mut command("python3", &["-m", "venv", ".venv"]))?;
    }
    let requirements = "tests/readers/requirements.txt";
    let pip =
        ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "-r", requirements];
    succeed(&mut command(PYTHON, &pip))?;
    // Its packages disagree with those of the readers.
    peers::mlflow().map(|_| ())
}

fn node_packages() -> anyhow::Result<()> {
    succeed(&mut command("npm", &["ci", "--no-audit", "--no-fund"]))
}

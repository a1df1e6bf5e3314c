//! Other simulators, installed beside the build: `cargo xtask peers` rebuilds our robots in them.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use anyhow::{Context, ensure};
use clap::Args;
use simd::InstructionSet;

use crate::bench::isa;
use crate::places::{repository, target};
use crate::process::{self, command, succeed};
use crate::{product, python};

#[derive(Debug, Args)]
pub struct Arguments {
    /// Number of robots to rebuild from each dataset
    #[arg(long, default_value_t = 50)]
    robots: u32,

    /// Names of the specs in tests/peers/specs whose datasets are used
    #[arg(value_name = "SPEC")]
    only: Vec<String>,
}

/// Makes a dataset of each spec, rebuilds its robots in MuJoCo and Pinocchio, and compares.
pub fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let specs = specs(&repository().join("tests/peers/specs"), &arguments.only)?;
    let torqued = product::build()?;
    let python = python()?;
    let mut rebuild = Command::new(python);
    rebuild.arg("tests/peers/rebuild.py").arg("--robots").arg(arguments.robots.to_string());
    for spec in specs {
        let folder = folder()?.join("datasets").join(spec.file_stem().unwrap_or_default());
        product::simulate_anew(&torqued, &spec, &folder)?;
        rebuild.arg(folder);
    }
    let finished = process::run(rebuild.current_dir(repository()))?;
    Ok(if finished.success { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// The specs of a folder in alphabetical order, or those of the given names.
fn specs(folder: &Path, only: &[String]) -> anyhow::Result<Vec<PathBuf>> {
    let entries =
        fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))?;
    let mut all = Vec::new();
    for entry in entries {
        let path = entry?.path();
        if path.extension().is_some_and(|extension| extension == "json") {
            all.push(path);
        }
    }
    all.sort();
    let name = |path: &Path| path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let names: Vec<String> = all.iter().map(|path| name(path)).collect();
    if let Some(unknown) = only.iter().find(|asked| !names.contains(asked)) {
        anyhow::bail!("there is no spec {unknown:?}, only {}", names.join(", "));
    }
    all.retain(|path| only.is_empty() || only.contains(&name(path)));
    Ok(all)
}

/// The folder for the files of peers.
fn folder() -> anyhow::Result<PathBuf> {
    let folder = target().join("peers");
    fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    Ok(folder)
}

/// A Python with MuJoCo, Pinocchio, pyarrow and polars.
pub fn python() -> anyhow::Result<PathBuf> {
    environment("venv", "tests/peers/requirements.txt")
}

/// A Python with PyTorch. Our networks are imported from the repository.
pub fn pytorch() -> anyhow::Result<PathBuf> {
    environment("pytorch", "crates/models/tests/peers/requirements.txt")
}

/// The folder of PyTorch's libraries and headers, in the version that the devices `torch` and `torch-tf32` are built with.
pub fn pytorch_libraries() -> anyhow::Result<PathBuf> {
    let requirements = "crates/models/tests/peers/libraries-requirements.txt";
    let python = environment("pytorch-libraries", requirements)?;
    let print = "import os, torch; print(os.path.dirname(torch.__file__))";
    let found = Command::new(python).args(["-c", print]).output()?;
    Ok(PathBuf::from(String::from_utf8(found.stdout)?.trim()))
}

/// A Python with frax, and the JAX version with which it is fastest.
pub fn frax() -> anyhow::Result<PathBuf> {
    environment("frax", "tests/peers/frax-requirements.txt")
}

/// A Python with MLflow's server.
pub fn mlflow() -> anyhow::Result<PathBuf> {
    environment("mlflow", "tests/peers/mlflow-requirements.txt")
}

/// A Python with MuJoCo's simulator on JAX.
pub fn mjx() -> anyhow::Result<PathBuf> {
    environment("mjx", "tests/peers/mjx-requirements.txt")
}

/// A Python with these requirements, in a separate environment.
fn environment(name: &str, requirements: &str) -> anyhow::Result<PathBuf> {
    python::environment(&folder()?.join(name), requirements)
}

/// Flags that Pinocchio's own CMake files set. Its headers do not compile without them.
const PINOCCHIO_DEFINITIONS: [&str; 4] = [
    "-DBOOST_MPL_LIMIT_LIST_SIZE=30",
    "-DBOOST_MPL_LIMIT_VECTOR_SIZE=30",
    "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS",
    "-DBOOST_FUSION_INVOKE_MAX_ARITY=12",
];

/// The flags with which Pinocchio is compiled: the highest optimisation for the measured
/// instruction set.
pub fn cxx_flags() -> [&'static str; 4] {
    let is_less = InstructionSet::available().first() != Some(&InstructionSet::best());
    let target = match is_less && isa::is_avx2(InstructionSet::best()) {
        true => "-march=x86-64-v3",
        false => "-march=native",
    };
    ["-std=c++20", "-O3", target, "-DNDEBUG"]
}

/// The program that measures Pinocchio from C++. It is compiled for this machine with the headers
/// of the Python package, which takes a minute the first time.
pub fn aba_rates() -> anyhow::Result<PathBuf> {
    let python = python()?;
    let headers = "import cmeel, pathlib; \
                   print(pathlib.Path(cmeel.__file__).parents[1] / 'cmeel.prefix' / 'include')";
    let output = Command::new(python).args(["-c", headers]).output()?;
    ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let headers = PathBuf::from(String::from_utf8(output.stdout)?.trim());

    let source = repository().join("tests/peers/aba_rates.cpp");
    let flags = cxx_flags();
    let program = folder()?.join(format!("aba_rates{}", flags[2]));
    if is_newer(&program, &source) {
        return Ok(program);
    }
    let mut compile = Command::new("g++");
    // Warnings in other projects' headers are suppressed.
    compile.args(flags).args(PINOCCHIO_DEFINITIONS).args(["-w", "-pthread"]);
    compile.arg("-isystem").arg(&headers).arg("-isystem").arg(headers.join("eigen3"));
    succeed(compile.arg(source).arg("-o").arg(&program))?;
    Ok(program)
}

/// A program with the queue of apalis. It is a separate project with its own locked crates.
pub fn apalis() -> anyhow::Result<PathBuf> {
    let built = folder()?.join("apalis");
    let manifest = "tests/peers/apalis/Cargo.toml";
    let mut build =
        command("cargo", &["build", "--release", "--locked", "--manifest-path", manifest]);
    succeed(build.env("CARGO_TARGET_DIR", &built))?;
    Ok(built.join("release/apalis_queue"))
}

/// A script with the queue of Graphile Worker, beside its dependencies.
pub fn graphile() -> anyhow::Result<PathBuf> {
    let installed = folder()?.join("graphile");
    fs::create_dir_all(&installed)?;
    for file in ["package.json", "package-lock.json", "queue.mjs"] {
        fs::copy(repository().join("tests/peers/graphile").join(file), installed.join(file))?;
    }
    succeed(
        command("npm", &["ci", "--silent", "--no-fund", "--no-audit"]).current_dir(&installed),
    )?;
    Ok(installed.join("queue.mjs"))
}

fn is_newer(made: &Path, from: &Path) -> bool {
    let modified = |path: &Path| fs::metadata(path).and_then(|metadata| metadata.modified());
    matches!((modified(made), modified(from)), (Ok(made), Ok(from)) if made > from)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(only: &[&str]) -> anyhow::Result<Vec<String>> {
        let folder = tempfile::tempdir()?;
        for file in ["b.json", "a.json", "notes.txt"] {
            fs::write(folder.path().join(file), "{}")?;
        }
        let only: Vec<String> = only.iter().map(|name| (*name).to_owned()).collect();
        let found = specs(folder.path(), &only)?;
        Ok(found
            .iter()
            .map(|path| path.file_name().unwrap().to_string_lossy().into_owned())
            .collect())
    }

    #[test]
    fn all_specs_are_taken_in_order_and_nothing_else() {
        assert_eq!(names(&[]).unwrap(), ["a.json", "b.json"]);
    }

    #[test]
    fn specs_can_be_chosen_by_name_and_a_wrong_name_is_answered_with_the_right_ones() {
        assert_eq!(names(&["b"]).unwrap(), ["b.json"]);
        let error = names(&["c"]).unwrap_err().to_string();
        assert_eq!(error, r#"there is no spec "c", only a, b"#);
    }

    #[test]
    fn a_program_older_than_its_source_is_made_anew() {
        let folder = tempfile::tempdir().unwrap();
        let (program, source) = (folder.path().join("program"), folder.path().join("source"));
        fs::write(&source, "").unwrap();
        assert!(!is_newer(&program, &source), "there is no program yet");
        let file = fs::File::create(&program).unwrap();
        let written = fs::metadata(&source).unwrap().modified().unwrap();
        file.set_modified(written + std::time::Duration::from_secs(1)).unwrap();
        assert!(is_newer(&program, &source));
        file.set_modified(written - std::time::Duration::from_secs(1)).unwrap();
        assert!(!is_newer(&program, &source));
    }
}

//! `cargo xtask test`: all checks that a change must pass.

mod counts;
mod failures;
mod install;
mod one_crate;

use std::num::NonZeroUsize;
use std::process::{Command, ExitCode};
use std::thread;
use std::time::Instant;

use clap::Args;

use crate::peers;
use crate::places::{repository, target};
use crate::process::{self, command};
use counts::Counts;
use install::Installation;

#[derive(Debug, Args)]
pub struct Arguments {
    /// Leave out tests that need installed packages: the Python readers and the browser
    #[arg(long)]
    quick: bool,

    /// Test models on devices other than the processor, too. This builds torqued with `gpu` and
    /// `ndarray`, then with `torch`, and takes longer than everything else together
    #[arg(long)]
    devices: bool,

    /// Run only the tests of this crate, from the build that all crates share
    #[arg(long, short, value_name = "CRATE", conflicts_with_all = ["quick", "devices"])]
    package: Option<String>,

    /// With `--package`: arguments for the runner, such as `-E 'test(name)'` for nextest
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, requires = "package")]
    further: Vec<String>,
}

/// One part of the test run. A failing one does not hide those after it.
struct Step {
    name: &'static str,
    command: Command,
    /// Reads the counts from the command's output. Without it, the step counts as one test.
    count: Option<fn(&str) -> Option<Counts>>,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    if let Some(package) = &arguments.package {
        return one_crate::run(package, &arguments.further);
    }
    let mut total = Counts::default();
    let mut failed = Vec::new();
    let mut record = |name: &'static str, counts: Counts, text: &str| {
        total += counts;
        if counts.failed > 0 {
            failed.push((name, text.to_owned()));
        }
    };
    if !arguments.quick {
        // The build of tests needs it.
        let (name, counts, text) = install(&install::NEXTEST);
        record(name, counts, &text);
    }
    // Deletes the list of an earlier run, if there is one.
    let _ = std::fs::remove_file(skipped_tests());
    let mut flaky = Vec::new();
    // Packages are downloaded and unpacked while the tests are compiled.
    let (installed, built) = thread::scope(|scope| {
        let all = install::ALL.iter().filter(|_| !arguments.quick);
        let further = install::FOR_DEVICES.iter().filter(|_| arguments.devices);
        let installing = scope.spawn(|| all.chain(further).map(install).collect::<Vec<_>>());
        let built: Vec<_> = before_tests().into_iter().map(|step| take_one(step, true)).collect();
        (installing.join().expect("an installation does not panic"), built)
    });
    for (name, counts, text) in installed.into_iter().chain(built) {
        record(name, counts, &text);
    }
    for steps in steps(arguments) {
        for (name, counts, text) in take(steps) {
            record(name, counts, &text);
            flaky.extend(failures::flaky(&text).map(str::to_owned));
        }
    }
    for (name, text) in &failed {
        eprintln!("\n== failed: {name}");
        for line in failures::of_output(text) {
            eprintln!("{line}");
        }
    }
    if !failed.is_empty() {
        let names: Vec<&str> = failed.iter().map(|(name, _)| *name).collect();
        eprintln!("\nfailed: {}", names.join(", "));
    }
    for test in flaky {
        eprintln!("passed at the second try: {test}");
    }
    for test in std::fs::read_to_string(skipped_tests()).unwrap_or_default().lines() {
        eprintln!("skipped: {test}");
    }
    println!("{} passed, {} failed", total.passed, total.failed);
    Ok(if total.failed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// The name, the counts and the output of a step.
type Taken = (&'static str, Counts, String);

fn install(installation: &Installation) -> Taken {
    eprintln!("\n== {}", installation.name);
    let started = Instant::now();
    let text = match (installation.run)() {
        Ok(()) => String::new(),
        Err(error) => format!("error: {error:#}"),
    };
    let seconds = started.elapsed().as_secs();
    let outcome = if text.is_empty() { "done" } else { &text };
    eprintln!("== {}: {outcome}, {seconds} s", installation.name);
    (installation.name, Counts::one(text.is_empty()), text)
}

/// Runs steps side by side.
fn take(steps: Vec<Step>) -> Vec<Taken> {
    let has_neighbours = steps.len() > 1;
    thread::scope(|scope| {
        let take = |step| scope.spawn(move || take_one(step, has_neighbours));
        let running: Vec<_> = steps.into_iter().map(take).collect();
        running.into_iter().map(|step| step.join().expect("a step does not panic")).collect()
    })
}

/// Runs a step, with its name in front of its lines if others run beside it.
fn take_one(mut step: Step, has_neighbours: bool) -> Taken {
    let label = if has_neighbours { format!("{}: ", step.name) } else { String::new() };
    eprintln!("\n== {}", step.name);
    let started = Instant::now();
    let (counts, text) = match process::run_named(&label, &mut step.command) {
        Ok(finished) => {
            let counts = match step.count {
                Some(count) => {
                    count(&finished.text).unwrap_or_default().agreeing_with(finished.success)
                }
                None => Counts::one(finished.success),
            };
            (counts, finished.text)
        }
        Err(error) => {
            let text = format!("error: {error:#}");
            eprintln!("{text}");
            (Counts::one(false), text)
        }
    };
    let seconds = started.elapsed().as_secs();
    eprintln!("== {}: {} passed, {} failed, {seconds} s", step.name, counts.passed, counts.failed);
    (step.name, counts, text)
}

/// The steps that need no installed packages, in their order.
fn before_tests() -> [Step; 2] {
    let format = command("cargo", &["fmt", "--all", "--check"]);
    [
        Step { name: "formatting", command: format, count: None },
        Step { name: "build of tests", command: build_of_tests(), count: None },
    ]
}

/// All further steps in their order. Those of one list run side by side.
fn steps(Arguments { quick, devices, .. }: &Arguments) -> Vec<Vec<Step>> {
    // Tests wait for servers, workers and timeouts for half of their time, which clippy uses.
    let tests = vec![
        Step {
            name: "tests",
            command: with_skipped_tests(nextest_or_cargo_test(*quick)),
            count: Some(|text| counts::nextest(text).or_else(|| counts::cargo_test(text))),
        },
        clippy(),
    ];
    let mut steps = vec![Step {
        name: "doc tests",
        command: command("cargo", &["test", "--release", "--workspace", "--doc"]),
        count: Some(counts::cargo_test),
    }];
    let (mut beside, mut alone) = (Vec::new(), Vec::new());
    if *devices {
        steps.push(Step {
            name: "device tests",
            command: with_skipped_tests(device_tests("torqued/gpu,torqued/ndarray")),
            count: Some(counts::nextest),
        });
        steps.push(Step {
            name: "device tests with PyTorch",
            command: with_skipped_tests(with_pytorch(device_tests("torqued/torch"))),
            count: Some(counts::nextest),
        });
    }
    if !quick {
        // This step follows the device tests, because their program has the same name.
        steps.push(Step {
            name: "build",
            command: command("cargo", &["build", "--release", "--bin", "torqued"]),
            count: None,
        });
        steps.push(Step { name: "packages", command: dist(), count: None });
        beside.push(Step {
            name: "installed packages",
            command: with_product(installed_packages()),
            count: Some(counts::unittest),
        });
        beside.extend(READERS.map(|(name, files)| Step {
            name,
            command: with_product(readers(files)),
            count: Some(counts::unittest),
        }));
        // Its pages have to answer within seconds, so nothing runs beside it.
        alone.push(Step {
            name: "browser",
            command: with_product(command(
                "node",
                &["--test", "--test-reporter=tap", "tests/browser/"],
            )),
            count: Some(counts::node),
        });
    }
    let one_by_one = |steps: Vec<Step>| steps.into_iter().map(|step| vec![step]);
    let groups = std::iter::once(tests).chain(one_by_one(steps)).chain([beside]);
    groups.chain(one_by_one(alone)).collect()
}

/// Checks the code with the processor's spare time, because tests beside it have to keep theirs.
fn clippy() -> Step {
    let clippy = ["clippy", "--release", "--workspace", "--all-targets", "--", "-D", "warnings"];
    let mut command = command("nice", &["-n", "19", "cargo"]);
    command.args(clippy);
    Step { name: "clippy", command, count: None }
}

/// The file in which tests report that this machine cannot run them, one line `NAME: REASON` each.
/// Their runner counts them as passed.
fn skipped_tests() -> std::path::PathBuf {
    repository().join("target/skipped-tests.txt")
}

/// All tests of the workspace. Examples are benchmarks: clippy compiles them, and nothing here runs
/// them.
const WORKSPACE: [&str; 4] = ["--workspace", "--lib", "--bins", "--tests"];

/// Where nextest finds the tests that were built. Otherwise it would ask cargo, which waits until
/// clippy ends.
fn test_programs() -> std::path::PathBuf {
    target().join("test-programs.json")
}

/// Compiles the tests.
fn build_of_tests() -> Command {
    if !process::exists("cargo-nextest") {
        let mut command = command("cargo", &["test", "--release", "--no-run"]);
        command.args(WORKSPACE);
        return command;
    }
    let tests = WORKSPACE.join(" ");
    let list = format!(
        "cargo nextest list --cargo-profile release {tests} --list-type binaries-only \
         --message-format json > \"$0\""
    );
    let mut command = command("sh", &["-c", &list]);
    command.arg(test_programs());
    command
}

/// Without installs, plain `cargo test` replaces a missing nextest, and tests of PostgreSQL are
/// left out where it is missing.
fn nextest_or_cargo_test(quick: bool) -> Command {
    let without_postgresql = quick && !install::has_postgresql();
    if without_postgresql {
        let _ = std::fs::write(skipped_tests(), "postgres::*: PostgreSQL is not installed\n");
    }
    if process::exists("cargo-nextest") {
        let mut command = command("cargo", &["nextest", "run", "--no-fail-fast"]);
        command.arg("--binaries-metadata").arg(test_programs());
        // The outputs of failed tests then follow the summary, so that they are repeated at the
        // end of the run.
        command.args(["--failure-output", "immediate-final"]);
        // Hundreds of tests start servers and wait for them. One that failed on a machine that
        // stood still for a while is tried again and is named at the end of the run.
        command.args(["--retries", "1"]);
        command.args(["--test-threads", &test_threads().to_string()]);
        if without_postgresql {
            command.args(["--filterset", "not test(/^postgres::/)"]);
        }
        command
    } else {
        let mut command = command("cargo", &["test", "--release", "--no-fail-fast"]);
        command.args(WORKSPACE);
        if without_postgresql {
            command.args(["--", "--skip", "postgres::"]);
        }
        command
    }
}

/// Tests that run at the same time. They wait for servers, workers and timeouts for half of their
/// time, so a few cores can run more tests than cores.
fn test_threads() -> usize {
    std::thread::available_parallelism().map_or(1, NonZeroUsize::get).max(4)
}

/// Builds models and program with the `features` of devices, and runs only their tests.
fn device_tests(features: &str) -> Command {
    let mut command = command("cargo", &["nextest", "run", "--cargo-profile", "release"]);
    // It has the workspace's features, so that both builds share their common parts.
    command.arg("--workspace");
    command.args(["--features", features]);
    command.args(["--test", "devices", "--test", "product", "--no-fail-fast"]);
    command.args(["--filterset", "binary(devices) | test(/^devices::/) | test(/^torch::/)"]);
    command
}

/// Lets the build and the tests find PyTorch.
fn with_pytorch(mut command: Command) -> Command {
    // A failure to install it is reported apart. Without its folder, the build fails and says why.
    let folder = peers::pytorch_libraries().unwrap_or_default();
    command.env("LD_LIBRARY_PATH", folder.join("lib"));
    // The crate `kernels` has tests of its own.
    command.arg("--lib");
    command.env("LIBTORCH", folder).env("LIBTORCH_BYPASS_VERSION_CHECK", "1");
    command
}

fn with_skipped_tests(mut command: Command) -> Command {
    command.env("SKIPPED_TESTS", skipped_tests());
    command
}

/// Makes the packages, like `cargo xtask dist`.
///
/// The build of tests has replaced the program of this process, so its path is told by cargo's
/// folder: the system would name the file that was deleted.
fn dist() -> Command {
    command(&target().join("release/xtask").to_string_lossy(), &["dist"])
}

fn installed_packages() -> Command {
    let tests = ["-m", "unittest", "discover", "--verbose", "--start-directory", "tests/install"];
    let mut command = command(install::PYTHON, &tests);
    command.env("PYTHONPATH", repository().join("tests/readers"));
    command
}

/// The files of readers' tests, halves of about the same duration.
const READERS: [(&str, &str); 2] =
    [("readers, a to g", "test_[a-g]*.py"), ("readers, h to z", "test_[h-z]*.py")];

fn readers(files: &str) -> Command {
    let discover = ["-m", "unittest", "discover", "--verbose", "--start-directory"];
    let mut command = command(install::PYTHON, &discover);
    command.args(["tests/readers", "--pattern", files]);
    command
}

/// Sets the program's path for tests in other languages.
fn with_product(mut command: Command) -> Command {
    command.env("TORQUED", repository().join("target/release/torqued"));
    command
}

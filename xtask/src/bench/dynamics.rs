//! Forward dynamics and whole trajectories per second, beside Pinocchio and MuJoCo.
//!
//! Our program and the others take turns, so that other load on the machine affects all of them.
//! Medians count. One evaluation of ours includes sines, cosines and its share of the integrator.
//! Pinocchio's is a call of `aba`, and MuJoCo's a call of `mj_step` with the integrator that is
//! implicit in damping. Trajectories are compared at equal accuracy: MuJoCo uses the fewest
//! Runge-Kutta steps per sample that keep its errors within the bound for ours.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, ensure};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use series::median;
use tempfile::TempDir;

use super::measurement::{Goal, Measurement, Peer};
use super::wanted::{BenchmarkResults, Peers, Wanted};
use super::{million, peak};
use crate::{machine, peers, product};

const ROUNDS: usize = 5;

/// Trajectories on which accuracy is measured.
const COMPARED: u64 = 128;

/// The bound on the 99th percentile of the trajectories' errors, µrad.
const ACCURACY: Goal = Goal::AtMost(100.0);

/// Operations of forward dynamics as a share of the processor's peak in multiply-adds, percent.
const SHARE_OF_PEAK: Goal = Goal::AtLeast(60.0);

/// A spec with both families of excitation and gravity. Nothing is rejected, so that all programs
/// do the same work.
pub(super) fn spec(trajectories: u64) -> Value {
    json!({
        "kind": "simulate",
        "trajectories": trajectories,
        "seed": 1,
        "excitation": {
            "chirp": {"frequency_hz": {"uniform": [0.1, 0.7]}},
            "multisine": {"frequency_hz": {"uniform": [0.05, 0.3]}},
        },
        "robot": {"gravity": "on"},
        "rejection": {"position_margin_rad": null},
    })
}

pub(super) fn run(wanted: Wanted) -> anyhow::Result<BenchmarkResults> {
    let rates = product::build_example("rates")?;
    let torqued = product::build()?;
    let folder = tempfile::tempdir()?;
    let spec_file = folder.path().join("spec.json");
    std::fs::write(&spec_file, spec(COMPARED).to_string())?;
    let peers = match wanted.peers {
        Peers::LeftOut => None,
        Peers::Measured => Some(Simulators::prepare(&torqued, &spec_file, &folder)?),
    };

    let mut rounds = Vec::new();
    for round in 1..=ROUNDS {
        eprintln!("round {round} of {ROUNDS}");
        let ours = answer(Command::new(&rates).arg("--json").arg(&spec_file))?;
        let peaks = [1, 2].map(peak::multiply_adds_per_s);
        let before = rounds.first().and_then(|round: &Round| round.theirs.as_ref());
        let theirs = peers.as_ref().map(|peers| peers.measure(before)).transpose()?;
        rounds.push(Round { ours, peaks, theirs });
    }
    let accuracy = peers.as_ref().map(|peers| &peers.accuracy);
    let mut measurements = compare(&rounds, accuracy)?;
    measurements.extend(million::run(&torqued)?);
    Ok(BenchmarkResults { notes: notes(&rounds, accuracy), measurements })
}

/// Rates that `crates/dynamics/examples/rates.rs` prints.
#[derive(Clone, Debug, Deserialize)]
pub(super) struct Ours {
    instructions: String,
    precision: String,
    threads: usize,
    trajectories_per_s: f64,
    pub(super) evaluations_per_s: f64,
    operations_per_evaluation: f64,
}

/// The output of `tests/peers/aba_rates.cpp`, with rates of one thread and of two.
#[derive(Clone, Debug, Deserialize)]
pub(super) struct Aba {
    pub(super) version: String,
    pub(super) evaluations_per_s: [f64; 2],
}

/// The output of `tests/peers/mujoco_rates.py`, with rates of one thread and of two.
#[derive(Clone, Debug, Deserialize)]
struct MuJoCo {
    steps_per_s: [f64; 2],
    trajectories_per_s: [f64; 2],
}

/// The output of `tests/peers/jax_rates.py`, with the rate of all cores.
#[derive(Clone, Debug, Deserialize)]
struct OnJax {
    version: String,
    jax: String,
    batch: u32,
    evaluations_per_s: f64,
}

/// One measurement of every peer.
struct Theirs {
    aba: Aba,
    mujoco: MuJoCo,
    frax: OnJax,
    mjx: OnJax,
}

/// Runge-Kutta steps per sample that MuJoCo needs, and the errors.
#[derive(Clone, Debug, Deserialize)]
struct Accuracy {
    version: String,
    substeps: u32,
    p99_rad: f64,
    recorded_p99_rad: f64,
}

/// One measurement of every program, in turn.
struct Round {
    ours: Vec<Ours>,
    /// Peak of f32 multiply-adds per second, on one thread and on two.
    peaks: [f64; 2],
    theirs: Option<Theirs>,
}

type OneOnJax = fn(&Theirs) -> &OnJax;

const ON_JAX: &[(&str, OneOnJax)] =
    &[("frax", |theirs| &theirs.frax), ("mujoco-mjx", |theirs| &theirs.mjx)];

/// The programs for the comparison, ready to be measured.
struct Simulators {
    python: PathBuf,
    /// Python environments with simulators on JAX.
    frax: PathBuf,
    mjx: PathBuf,
    aba: PathBuf,
    dataset: PathBuf,
    accuracy: Accuracy,
}

impl Simulators {
    fn prepare(torqued: &Path, spec_file: &Path, folder: &TempDir) -> anyhow::Result<Self> {
        let python = peers::python()?;
        let (frax, mjx) = (peers::frax()?, peers::mjx()?);
        let aba = peers::aba_rates()?;
        let dataset = folder.path().join("dataset");
        product::simulate_anew(torqued, spec_file, &dataset)?;
        let accuracy = answer(&mut mujoco_rates(&python, "accuracy", &dataset))?;
        Ok(Self { python, frax, mjx, aba, dataset, accuracy })
    }

    /// Measures all of them. Simulators on JAX use the batch sizes of `before`, which searched for
    /// the fastest.
    fn measure(&self, before: Option<&Theirs>) -> anyhow::Result<Theirs> {
        let substeps = self.accuracy.substeps.to_string();
        let mut mujoco = mujoco_rates(&self.python, "rates", &self.dataset);
        let batch = |of: fn(&Theirs) -> &OnJax| before.map(|before| of(before).batch);
        Ok(Theirs {
            aba: answer(&mut Command::new(&self.aba))?,
            mujoco: answer(mujoco.args(["--substeps", &substeps]))?,
            frax: self.on_jax(&self.frax, "frax", batch(|theirs| &theirs.frax))?,
            mjx: self.on_jax(&self.mjx, "mjx", batch(|theirs| &theirs.mjx))?,
        })
    }

    fn on_jax(&self, python: &Path, what: &str, batch: Option<u32>) -> anyhow::Result<OnJax> {
        let mut command = Command::new(python);
        command.args(["tests/peers/jax_rates.py", what]).arg(&self.dataset);
        command.env("JAX_PLATFORMS", "cpu");
        if let Some(batch) = batch {
            command.args(["--batch", &batch.to_string()]);
        }
        answer(&mut command)
    }
}

fn mujoco_rates(python: &Path, what: &str, dataset: &Path) -> Command {
    let mut command = Command::new(python);
    command.args(["tests/peers/mujoco_rates.py", what]).arg(dataset);
    command
}

/// Runs a program that prints JSON, in the repository unless the command says another folder.
pub(super) fn answer<T: DeserializeOwned>(command: &mut Command) -> anyhow::Result<T> {
    if command.get_current_dir().is_none() {
        command.current_dir(crate::places::repository());
    }
    let program = command.get_program().to_string_lossy().into_owned();
    let output = command.output().with_context(|| format!("cannot run {program}"))?;
    ensure!(output.status.success(), "{program}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout)
        .with_context(|| format!("{program} said {}", String::from_utf8_lossy(&output.stdout)))
}

/// The table of all measurements except those of the million trajectories.
fn compare(rounds: &[Round], accuracy: Option<&Accuracy>) -> anyhow::Result<Vec<Measurement>> {
    let theirs = |value: &dyn Fn(&Theirs) -> f64| {
        let values: Option<Vec<f64>> =
            rounds.iter().map(|round| round.theirs.as_ref().map(value)).collect();
        values.map(median)
    };
    let all_ours: Vec<&[Ours]> = rounds.iter().map(|round| round.ours.as_slice()).collect();
    let first = rounds[0].theirs.as_ref();
    let pinocchio = first.map(|theirs| format!("Pinocchio {}", theirs.aba.version));
    let mujoco = accuracy.map(|accuracy| format!("MuJoCo {}", accuracy.version));
    let peer = |value: Option<f64>, name: &Option<String>, what: &str| {
        let (value, name) = (value?, name.as_ref()?);
        Some(Peer { value, version: format!("{name} {what}") })
    };
    let rk4 = accuracy
        .map_or_else(String::new, |accuracy| format!("RK4, {} per sample", accuracy.substeps));
    let mut measurements = Vec::new();
    for (precision, aba_goal, step_goal, trajectory_goal) in
        [("f32", 80.0, 150.0, Some(200.0)), ("f64", 40.0, 60.0, None)]
    {
        for threads in [1, 2] {
            let ours = |value: fn(&Ours) -> f64| our_median(&all_ours, precision, threads, value);
            // The goals are for two cores.
            let goal = |bound: Option<f64>| bound.filter(|_| threads == 2).map(Goal::AtLeast);
            let of = format!("{precision}, {}", in_words(threads));
            let evaluations = ours(|ours| ours.evaluations_per_s / 1e6)?;
            let trajectories = ours(|ours| ours.trajectories_per_s)?;
            let aba = theirs(&|theirs| theirs.aba.evaluations_per_s[threads - 1] / 1e6);
            let steps = theirs(&|theirs| theirs.mujoco.steps_per_s[threads - 1] / 1e6);
            let driven = theirs(&|theirs| theirs.mujoco.trajectories_per_s[threads - 1]);
            let aba = peer(aba, &pinocchio, "aba");
            let steps = peer(steps, &mujoco, "mj_step");
            let driven = peer(driven, &mujoco, &rk4);
            let name = format!("evaluations, {of}");
            let goals = (goal(Some(aba_goal)), goal(Some(step_goal)), goal(trajectory_goal));
            measurements.push(Measurement::compared(&name, evaluations, aba, "M/s", goals.0));
            if steps.is_some() {
                measurements.push(Measurement::compared(&name, evaluations, steps, "M/s", goals.1));
            }
            // They use all cores. Our measurement used two.
            let on_jax = if precision == "f32" && threads == 2 { ON_JAX } else { &[] };
            for (peer, of) in on_jax {
                let Some(value) = theirs(&|theirs| of(theirs).evaluations_per_s / 1e6) else {
                    continue;
                };
                let version = first.map_or("", |theirs| &of(theirs).version);
                let peer = Peer { value, version: format!("{peer} {version}") };
                measurements.push(Measurement::compared(
                    &name,
                    evaluations,
                    Some(peer),
                    "M/s",
                    None,
                ));
            }
            let name = format!("trajectories, {of}");
            measurements.push(Measurement::compared(name, trajectories, driven, "1/s", goals.2));
        }
    }
    for (precision, width, goal) in [("f32", 1.0, Some(SHARE_OF_PEAK)), ("f64", 2.0, None)] {
        for threads in [1, 2] {
            let done = our_median(&all_ours, precision, threads, |ours| {
                ours.evaluations_per_s * ours.operations_per_evaluation
            })?;
            let peaks: Vec<f64> = rounds.iter().map(|round| round.peaks[threads - 1]).collect();
            let share = 100.0 * done * width / median(peaks);
            let name = format!("share of peak, {precision}, {}", in_words(threads));
            measurements.push(Measurement::alone(name, share, "%", goal));
        }
    }
    if let Some(accuracy) = accuracy {
        let ours = accuracy.recorded_p99_rad * 1e6;
        let name = "p99 error of trajectories, f32";
        measurements.push(Measurement::alone(name, ours, "µrad", Some(ACCURACY)));
        let theirs = accuracy.p99_rad * 1e6;
        let name = format!("p99 error of MuJoCo's, {rk4}");
        measurements.push(Measurement::alone(name, theirs, "µrad", Some(ACCURACY)));
    }
    Ok(measurements)
}

pub(super) fn in_words(threads: usize) -> String {
    format!("{threads} thread{}", if threads == 1 { "" } else { "s" })
}

/// The median of a rate over rounds.
pub(super) fn our_median(
    rounds: &[&[Ours]],
    precision: &str,
    threads: usize,
    value: fn(&Ours) -> f64,
) -> anyhow::Result<f64> {
    let values: Vec<f64> = rounds
        .iter()
        .copied()
        .flatten()
        .filter(|ours| ours.precision == precision && ours.threads == threads)
        .map(value)
        .collect();
    ensure!(values.len() == rounds.len(), "no rates for {precision} on {threads} threads");
    Ok(median(values))
}

fn notes(rounds: &[Round], accuracy: Option<&Accuracy>) -> Vec<String> {
    let instructions = &rounds[0].ours[0].instructions;
    let mut notes = vec![
        format!("ours with {instructions}, chosen at run time; medians of {ROUNDS} rounds"),
        format!(
            "share of peak: {} operations per evaluation, of {:.1} and {:.1} G multiply-adds of f32 per second \
             on one thread and on two",
            rounds[0].ours[0].operations_per_evaluation,
            median(rounds.iter().map(|round| round.peaks[0]).collect()) / 1e9,
            median(rounds.iter().map(|round| round.peaks[1]).collect()) / 1e9,
        ),
        format!("simulated: {}", spec(million::TRAJECTORIES)),
    ];
    for (name, of) in ON_JAX {
        let Some(theirs) = rounds[0].theirs.as_ref().map(of) else { continue };
        notes.push(format!(
            "{name} on JAX {}: batches of {}, on all cores",
            theirs.jax, theirs.batch
        ));
    }
    if let Some(accuracy) = accuracy {
        notes.push(format!(
            "Pinocchio's aba from its headers: {} {}; one model, 1024 random states, the faster of \
             its conventions",
            machine::first_line_of("g++", &["--version"]),
            peers::cxx_flags().join(" "),
        ));
        notes.push(format!(
            "MuJoCo's C library: mj_step with implicitfast; whole trajectories with RK4, {} steps per \
             sample, the fewest that keep p99 below 100 µrad of {COMPARED} trajectories",
            accuracy.substeps,
        ));
    }
    notes
}

#[cfg(test)]
mod tests {
    use super::*;

    const PEAKS: [f64; 2] = [5e9, 1e10];

    fn ours(speed: f64) -> Vec<Ours> {
        let mut all = Vec::new();
        for (precision, factor) in [("f32", 2.0), ("f64", 1.0)] {
            for threads in [1, 2] {
                let rate = speed * factor * f64::from(u32::try_from(threads).unwrap());
                all.push(Ours {
                    instructions: "AVX2".to_owned(),
                    precision: precision.to_owned(),
                    threads,
                    trajectories_per_s: rate,
                    evaluations_per_s: rate * 1e6,
                    operations_per_evaluation: 1000.0,
                });
            }
        }
        all
    }

    fn theirs() -> Theirs {
        let aba = Aba { version: "4.1".to_owned(), evaluations_per_s: [0.5e6, 1e6] };
        let mujoco = MuJoCo { steps_per_s: [0.25e6, 0.5e6], trajectories_per_s: [0.25, 0.5] };
        let on_jax = |version: &str, rate| OnJax {
            version: version.to_owned(),
            jax: "0.4".to_owned(),
            batch: 256,
            evaluations_per_s: rate,
        };
        Theirs { aba, mujoco, frax: on_jax("0.1", 2e5), mjx: on_jax("3.1", 1e5) }
    }

    fn accuracy() -> Accuracy {
        Accuracy {
            version: "4.0".to_owned(),
            substeps: 5,
            p99_rad: 2.5e-5,
            recorded_p99_rad: 1.8e-5,
        }
    }

    fn find<'a>(measurements: &'a [Measurement], name: &str, peer: &str) -> &'a Measurement {
        let matches = |measurement: &&Measurement| {
            measurement.name == name
                && measurement.peer_version.as_deref().unwrap_or_default() == peer
        };
        measurements.iter().find(matches).unwrap_or_else(|| panic!("no {name} beside {peer}"))
    }

    #[test]
    fn goals_are_held_against_the_ratios_of_medians_on_two_threads() {
        let round = |speed| Round { ours: ours(speed), peaks: PEAKS, theirs: Some(theirs()) };
        let measurements =
            compare(&[round(1.0), round(41.0), round(1000.0)], Some(&accuracy())).unwrap();
        let aba = find(&measurements, "evaluations, f32, 2 threads", "Pinocchio 4.1 aba");
        assert_eq!((aba.ours, aba.peer, aba.ratio), (164.0, Some(1.0), Some(164.0)));
        assert_eq!((aba.goal, aba.met), (Some(Goal::AtLeast(80.0)), Some(true)));
        let steps = find(&measurements, "evaluations, f64, 2 threads", "MuJoCo 4.0 mj_step");
        assert_eq!((steps.ratio, steps.goal), (Some(164.0), Some(Goal::AtLeast(60.0))));
        let rk4 = "MuJoCo 4.0 RK4, 5 per sample";
        let driven = find(&measurements, "trajectories, f32, 2 threads", rk4);
        assert_eq!((driven.ratio, driven.met), (Some(328.0), Some(true)));
        let frax = find(&measurements, "evaluations, f32, 2 threads", "frax 0.1");
        assert_eq!((frax.peer, frax.ratio, frax.goal), (Some(0.2), Some(820.0), None));
        let single = find(&measurements, "evaluations, f32, 1 thread", "Pinocchio 4.1 aba");
        assert_eq!((single.ratio, single.goal), (Some(164.0), None));
    }

    #[test]
    fn errors_are_held_against_what_is_allowed() {
        let round = Round { ours: ours(1.0), peaks: PEAKS, theirs: Some(theirs()) };
        let accuracy = Accuracy { recorded_p99_rad: 1.1e-4, ..accuracy() };
        let measurements = compare(&[round], Some(&accuracy)).unwrap();
        let error = find(&measurements, "p99 error of trajectories, f32", "");
        assert_eq!(error.met, Some(false));
    }

    #[test]
    fn without_peers_there_are_our_rates_alone() {
        let measurements =
            compare(&[Round { ours: ours(1.0), peaks: PEAKS, theirs: None }], None).unwrap();
        assert_eq!(measurements.len(), 12);
        assert!(measurements.iter().all(|measurement| measurement.peer.is_none()));
    }

    #[test]
    fn shares_of_the_peak_count_operations_of_the_precision() {
        let round = |speed| Round { ours: ours(speed), peaks: PEAKS, theirs: None };
        let measurements = compare(&[round(1.0), round(2.0), round(3.0)], None).unwrap();
        // 4 and 8 million evaluations per second with 1000 operations each, of a peak of 5 and 10
        // G.
        let share = |name: &str| find(&measurements, name, "").ours;
        assert_eq!(share("share of peak, f32, 1 thread"), 80.0);
        assert_eq!(share("share of peak, f64, 2 threads"), 80.0);
    }

    #[test]
    fn a_rate_that_is_missing_is_an_error() {
        let mut some = ours(1.0);
        some.pop();
        let error = compare(&[Round { ours: some, peaks: PEAKS, theirs: None }], None).unwrap_err();
        assert_eq!(error.to_string(), "no rates for f64 on 2 threads");
    }

    #[test]
    fn what_the_programs_print_is_understood() {
        let printed = r#"[{"evaluations_per_s":8.1e7,"instructions":"AVX-512","precision":"f32",
            "operations_per_evaluation":950.5,"threads":1,"trajectories_per_s":2.0e4}]"#;
        let rates: Vec<Ours> = answer(Command::new("echo").arg(printed)).unwrap();
        assert_eq!((rates[0].threads, rates[0].evaluations_per_s), (1, 8.1e7));
        let nonsense = answer::<Vec<Ours>>(Command::new("echo").arg("fast")).unwrap_err();
        assert_eq!(nonsense.to_string(), "echo said fast\n");
        let failed = answer::<Vec<Ours>>(&mut Command::new("false")).unwrap_err();
        assert_eq!(failed.to_string(), "false: ");
    }
}

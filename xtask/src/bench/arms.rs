//! Forward dynamics per second of arms from URDFs, beside Pinocchio with the same URDF.
//!
//! No kernel is compiled for their structure. Programs take turns, and medians count, as in
//! [`super::dynamics`].

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::ensure;
use serde_json::{Value, json};
use simd::InstructionSet;

use super::dynamics::{Aba, Ours, answer, in_words, our_median};
use super::isa;
use super::measurement::{Goal, Measurement, Peer};
use super::wanted::{BenchmarkResults, Peers, Wanted};
use crate::{machine, peers, product};

const ROUNDS: usize = 5;

/// Arms of six and of seven joints, with their URDFs in the Python package example-robot-data.
const ARMS: [(&str, &str); 2] =
    [("UR5", "ur_description/urdf/ur5_robot.urdf"), ("xArm7", "xarm_description/urdf/xarm7.urdf")];

/// An arm, ready to be measured.
struct Arm {
    name: &'static str,
    spec: PathBuf,
    /// What `aba_rates` reads.
    joints: PathBuf,
}

/// Our rates and Pinocchio's in one round.
type Round = (Vec<Ours>, Option<Aba>);

pub(super) fn run(wanted: Wanted) -> anyhow::Result<BenchmarkResults> {
    let rates = product::build_example("rates")?;
    let torqued = product::build()?;
    let python = peers::python()?;
    let folder = tempfile::tempdir()?;
    let aba = match wanted.peers {
        Peers::LeftOut => None,
        Peers::Measured => Some(peers::aba_rates()?),
    };
    let arms = ARMS
        .iter()
        .map(|(name, urdf)| prepare(name, urdf, &torqued, &python, folder.path()))
        .collect::<anyhow::Result<Vec<Arm>>>()?;
    let mut rounds: Vec<Vec<Round>> = arms.iter().map(|_| Vec::new()).collect();
    for round in 1..=ROUNDS {
        eprintln!("round {round} of {ROUNDS}");
        for (arm, rounds) in arms.iter().zip(&mut rounds) {
            let ours = answer(Command::new(&rates).arg("--json").arg(&arm.spec))?;
            let theirs = aba.as_ref().map(|aba| answer(Command::new(aba).arg(&arm.joints)));
            rounds.push((ours, theirs.transpose()?));
        }
    }
    let mut measurements = Vec::new();
    for (arm, rounds) in arms.iter().zip(rounds) {
        measurements.extend(compare(arm.name, &rounds)?);
    }
    let notes = vec![
        format!(
            "ours with {}, chosen at run time; medians of {ROUNDS} rounds",
            InstructionSet::best()
        ),
        format!(
            "Pinocchio's aba from its headers: {} {}; one model, 1024 random states, the faster of its conventions",
            machine::first_line_of("g++", &["--version"]),
            peers::cxx_flags().join(" "),
        ),
        format!("URDFs of example-robot-data: {}", ARMS.map(|(_, urdf)| urdf).join(", ")),
    ];
    Ok(BenchmarkResults { notes, measurements })
}

fn prepare(
    name: &'static str,
    urdf: &str,
    torqued: &Path,
    python: &Path,
    folder: &Path,
) -> anyhow::Result<Arm> {
    let described = |what: &str| -> anyhow::Result<String> {
        let mut script = Command::new(python);
        script.args(["tests/peers/urdf_joints.py", what, urdf]);
        Ok(String::from_utf8(text_of(&mut script)?)?)
    };
    let path = described("path")?;
    let description =
        text_of(Command::new(torqued).args(["robot", "show", "--json", path.trim()]))?;
    let mut description: Value = serde_json::from_slice(&description)?;
    for joint in description["joints"].as_array_mut().into_iter().flatten() {
        // URDFs have no damping, and without any, the arms would be thrown about.
        joint["damping_nm_s_rad"] = json!(10);
        joint["armature_kg_m2"] = json!(0.01);
    }
    let spec = folder.join(name).with_extension("json");
    std::fs::write(&spec, self::spec(&description).to_string())?;
    let joints = folder.join(name).with_extension("txt");
    std::fs::write(&joints, described("joints")?)?;
    Ok(Arm { name, spec, joints })
}

fn text_of(command: &mut Command) -> anyhow::Result<Vec<u8>> {
    let output = command.current_dir(crate::places::repository()).output()?;
    ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Ok(output.stdout)
}

/// Nothing is rejected, so that every evaluation counts.
fn spec(description: &Value) -> Value {
    json!({
        "kind": "simulate",
        "trajectories": 1_000_000,
        "seed": 1,
        "excitation": {"multisine": {"frequency_hz": {"uniform": [0.05, 0.15]}}},
        "robot": {"model": description, "gravity": "on"},
        "rejection": {"position_margin_rad": null},
    })
}

fn compare(arm: &str, rounds: &[Round]) -> anyhow::Result<Vec<Measurement>> {
    let least = if isa::is_avx2(InstructionSet::best()) { 40.0 } else { 60.0 };
    let ours: Vec<&[Ours]> = rounds.iter().map(|(ours, _)| ours.as_slice()).collect();
    let mut measurements = Vec::new();
    for precision in ["f32", "f64"] {
        for threads in [1, 2] {
            let rate = our_median(&ours, precision, threads, |ours| ours.evaluations_per_s / 1e6)?;
            let theirs: Option<Vec<&Aba>> = rounds.iter().map(|(_, aba)| aba.as_ref()).collect();
            let peer = theirs.map(|theirs| Peer {
                value: series::median(
                    theirs.iter().map(|aba| aba.evaluations_per_s[threads - 1] / 1e6).collect(),
                ),
                version: format!("Pinocchio {} aba", theirs[0].version),
            });
            let goal = (precision == "f32" && threads == 2).then_some(Goal::AtLeast(least));
            let name = format!("evaluations of {arm}, {precision}, {}", in_words(threads));
            measurements.push(Measurement::compared(name, rate, peer, "M/s", goal));
        }
    }
    Ok(measurements)
}

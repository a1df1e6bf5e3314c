//! Identifications from a URDF and logs, beside `mujoco.sysid` with the same free numbers.
//!
//! Each runs once: both always take the same steps. The logs are those of the guide, and those of a
//! real UR10e where they lie beside the repository.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::Context;
use serde::Deserialize;
use serde_json::Value;

use super::dynamics::answer;
use super::measurement::{Goal, Measurement, Peer};
use super::wanted::{BenchmarkResults, Peers, Wanted};
use crate::places::repository;
use crate::process::succeed;
use crate::{peers, product};

/// Logs of an arm. Columns have numbers.
struct Case {
    name: &'static str,
    folder: PathBuf,
    urdf: &'static str,
    fit: &'static [&'static str],
    validation: &'static str,
    columns: [&'static str; 6],
    gains: &'static str,
    /// The most iterations of `mujoco.sysid`.
    iterations: &'static str,
}

/// What `tests/peers/mujoco_sysid.py` prints.
#[derive(Deserialize)]
struct Theirs {
    mujoco: String,
    processor_seconds: f64,
    peak_mib: f64,
    validation: Value,
}

const HORIZONS: [&str; 3] = ["0.1 s", "0.5 s", "1.33 s"];

/// Errors as a share of the peer's.
const ERRORS: Goal = Goal::AtMost(1.0);

/// Processor time as a share of the peer's.
const TIME: Goal = Goal::AtMost(0.05);

pub(super) fn run(wanted: Wanted) -> anyhow::Result<BenchmarkResults> {
    let torqued = product::build()?;
    let python = match wanted.peers {
        Peers::LeftOut => None,
        Peers::Measured => Some(peers::python()?),
    };
    let folder = tempfile::tempdir()?;
    let mut notes = Vec::new();
    let mut measurements = Vec::new();
    let mut cases = vec![guide(folder.path())?];
    match ur10e() {
        Some(case) => cases.push(case),
        None => notes.push("no logs of a UR10e lie beside the repository".to_owned()),
    }
    for case in cases {
        eprintln!("{}", case.name);
        let out = folder.path().join(case.name);
        let mut identify = Command::new(&torqued);
        identify.arg("identify").args(case.arguments()).arg("--out").arg(&out);
        let cost = product::cost_of(identify.current_dir(&case.folder))?;
        let report: Value = serde_json::from_slice(&std::fs::read(out.join("report.json"))?)?;
        let theirs: Option<Theirs> = python
            .as_ref()
            .map(|python| {
                let mut peer = Command::new(python);
                peer.arg(repository().join("tests/peers/mujoco_sysid.py")).args(case.arguments());
                peer.args(["--iterations", case.iterations]).current_dir(&case.folder);
                answer(&mut peer)
            })
            .transpose()?;
        measurements.extend(compare(&case, &report, &cost, theirs.as_ref())?);
    }
    Ok(BenchmarkResults { notes, measurements })
}

/// The logs of `docs/guides/urdf.md`.
fn guide(folder: &Path) -> anyhow::Result<Case> {
    let script = repository().join("docs/examples/my_arm.py");
    succeed(Command::new("python3").arg(script).current_dir(folder))?;
    Ok(Case {
        name: "two joints",
        folder: folder.to_owned(),
        urdf: "arm.urdf",
        fit: &["monday.csv"],
        validation: "tuesday.csv",
        columns: ["--time", "1", "--q", "4-5", "--u", "2-3"],
        gains: "1,1",
        iterations: "30",
    })
}

/// Logs of Mamedov et al., which are not part of the repository.
fn ur10e() -> Option<Case> {
    let folder = repository().join("../shared/reference/real/ur10e");
    let is_there = folder.exists();
    is_there.then_some(Case {
        name: "UR10e",
        folder,
        urdf: "ur10e.urdf",
        fit: &["ur-20_02_12-40sec_12harm.csv", "ur-20_02_12-50sec_12harm.csv"],
        validation: "ur-20_02_19_14harm50sec.csv",
        columns: ["--time", "1", "--q", "2-7", "--u", "14-19"],
        gains: "14.87,13.26,11.13,10.62,11.03,11.47",
        iterations: "15",
    })
}

impl Case {
    /// What both programs take.
    fn arguments(&self) -> Vec<&str> {
        let mut arguments = vec![self.urdf];
        arguments.extend(self.fit);
        arguments.extend(["--validate", self.validation, "--gains", self.gains]);
        arguments.extend(self.columns);
        arguments
    }
}

fn compare(
    case: &Case,
    report: &Value,
    cost: &product::Cost,
    theirs: Option<&Theirs>,
) -> anyhow::Result<Vec<Measurement>> {
    let peer = |value: fn(&Theirs) -> f64| {
        theirs.map(|theirs| Peer {
            value: value(theirs),
            version: format!("mujoco.sysid {}", theirs.mujoco),
        })
    };
    let errors =
        report["arm"]["validation_errors"].as_array().context("the report has no errors")?;
    let identified = errors.iter().find(|errors| errors["predictor"] == "identified");
    let identified = identified.context("the report has no identified arm")?;
    let mut measurements = Vec::new();
    for (at, horizon) in HORIZONS.iter().enumerate() {
        let ours = identified["rmse_deg"][at].as_f64().unwrap_or(f64::INFINITY);
        let of = |theirs: &Theirs| theirs.validation["mujoco.sysid"][at].as_f64();
        let peer = theirs.map(|theirs| Peer {
            value: of(theirs).unwrap_or(f64::INFINITY),
            version: format!("mujoco.sysid {}", theirs.mujoco),
        });
        let name = format!("{}: error over {horizon}", case.name);
        measurements.push(Measurement::compared(name, ours, peer, "°", Some(ERRORS)));
    }
    let (name, seconds) = (format!("{}: processor time", case.name), cost.processor_seconds);
    let theirs_s = peer(|theirs| theirs.processor_seconds);
    measurements.push(Measurement::compared(name, seconds, theirs_s, "s", Some(TIME)));
    let (name, mib) = (format!("{}: memory", case.name), 1024.0 * cost.peak_gib);
    let theirs_mib = peer(|theirs| theirs.peak_mib);
    measurements.push(Measurement::compared(name, mib, theirs_mib, "MiB", None));
    Ok(measurements)
}

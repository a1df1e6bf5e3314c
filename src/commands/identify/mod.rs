//! From an arm and logs to an identified arm, on this machine.

mod hints;
mod log;
mod search;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, anyhow, ensure};
use clap::Args;
use identification::{IdentificationError, Recording, Settings};
use log::{LogArguments, LogFile};
use spec::IdentifySpec;
use wire::ArmReport;
use worker::{ArmFile, IdentifiedArm};

use crate::commands::result_folder::ResultFolder;
use crate::exit::INTERRUPTED;
use crate::kept_robot::AnyRobotArguments;
use crate::output::write_json;
use crate::progress::{self, OwnWork};
use crate::robots::Urdf;
use search::{Found, Search};

#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    robot: AnyRobotArguments,

    /// Logs of the arm with times, positions and torques: text, Parquet, NumPy (.npz) or MCAP files, or a bag's folder with one MCAP file
    #[arg(value_name = "LOG", required = true)]
    logs: Vec<PathBuf>,

    /// A log that the identified arm is tried on; may be given several times
    #[arg(long = "validate", value_name = "LOG")]
    validation: Vec<PathBuf>,

    /// A log with a load in the hand, whose mass and centre are identified; may be given several times, and each log has a load of its own
    #[arg(long = "load", value_name = "LOG")]
    loads: Vec<PathBuf>,

    /// All logs of --load have the same load
    #[arg(long, requires = "loads")]
    same_load: bool,

    #[command(flatten)]
    columns: LogArguments,

    /// Folder for the identified arm; it must not exist or be empty
    #[arg(long, value_name = "DIR", default_value = "identified")]
    out: PathBuf,

    /// The edge of the low-pass for positions and torques, Hz; it has no delay
    #[arg(long, value_name = "HZ", default_value_t = Settings::default().low_pass_hz)]
    low_pass_hz: f64,

    /// How far a torque may be off by its gain, as a standard deviation [default: 0.15 with --gains, otherwise 0]
    #[arg(long, value_name = "SHARE")]
    gain_deviation: Option<f64>,

    /// How late or early against positions torques may be recorded, s; the delay is identified
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0)]
    most_delay_s: f64,

    /// The most steps on motions; 0 fits torques only
    #[arg(long, value_name = "N", default_value_t = Settings::default().motion_steps)]
    motion_steps: usize,

    /// Print the report as JSON
    #[arg(long)]
    json: bool,
}

/// Standard deviation of the gains of motors whose torque is computed from their current.
const GAIN_DEVIATION_OF_CURRENTS: f64 = 0.15;

pub async fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let robot = arguments.robot.read().await?;
    let reader = arguments.columns.reader(robot.description())?;
    let settings = settings(arguments, reader.gains().is_some())?;
    for doubt in &robot.doubts {
        eprintln!("warning: {doubt}");
    }
    let _folder = ResultFolder::prepare(&arguments.out)?;
    let description = robot.description();
    let read = |paths: &[PathBuf]| -> anyhow::Result<Vec<LogFile>> {
        paths.iter().map(|path| reader.read(path)).collect()
    };
    let (logs, validation, loads) =
        (read(&arguments.logs)?, read(&arguments.validation)?, read(&arguments.loads)?);
    for note in [&logs, &validation, &loads].into_iter().flatten().flat_map(|log| &log.notes) {
        eprintln!("note: {note}");
    }
    let first = logs.iter().flat_map(|file| &file.logs).next();
    let rate_hz = first.context("no recording has two rows")?.rate_hz();
    let recordings = |logs: &[LogFile]| -> Vec<Recording> {
        logs.iter().flat_map(|file| &file.logs).map(|log| log.recording(rate_hz)).collect()
    };
    let per_load = if arguments.same_load { loads.len() } else { 1 };
    let search = Search {
        description: description.clone(),
        fit: recordings(&logs),
        validation: recordings(&validation),
        loads: loads.chunks(per_load.max(1)).map(recordings).collect(),
        settings,
    };
    let work = OwnWork::search("identify", search.steps());
    let found = progress::follow_own(work, move |progress| search.run(progress)).await?;
    if matches!(found, Err(IdentificationError::Stopped)) {
        eprintln!("interrupted");
        return Ok(ExitCode::from(INTERRUPTED));
    }
    let Found { arm: found, loads } = found.map_err(with_flag)?;

    let arm = IdentifiedArm {
        described: description,
        urdf: robot.urdf.as_ref().map(|Urdf { text, arm }| (text.as_str(), arm)),
        found: &found,
        loads: &loads,
    };
    for ArmFile { name, bytes, .. } in arm.files()? {
        let path = arguments.out.join(&name);
        fs::write(&path, bytes).with_context(|| format!("cannot write {}", path.display()))?;
    }
    let report = arm.report();
    if arguments.json {
        write_json(&report)?;
        return Ok(ExitCode::SUCCESS);
    }
    print!("{}", reports::identification::text(&report));
    if let Some(given) = reader.gains()
        && settings.gain_deviation > 0.0
    {
        let each = given.iter().zip(found.arm.gains());
        let gains: Vec<String> =
            each.map(|(given, found)| format!("{:.4}", given / found)).collect();
        println!(
            "\nThe gains that give this arm's torques, for `columns.gains` of an import: {}.",
            gains.join(", ")
        );
    }
    println!("\n{}", closing(&arguments.out.join("description.json"), &report.arm));
    Ok(ExitCode::SUCCESS)
}

/// The last sentences about an identified arm.
fn closing(description: &Path, report: &ArmReport) -> String {
    let path = description.display();
    if identification::fits(report) {
        return format!(
            "The identified arm is {path}, which jobs take as `robot.model`. Their specs need \"friction\": {{}} beside the \
             model, or they leave its friction out. parameters.csv in the same folder has every number."
        );
    }
    format!(
        "The recordings do not fit the identified arm: do not use {path} before the warnings above are settled. Look at \
         torques.svg and motion.svg beside it."
    )
}

/// The error with the flag where it names the field of a spec.
fn with_flag(error: IdentificationError) -> anyhow::Error {
    match error {
        IdentificationError::LowPass { .. } => {
            anyhow!(error.to_string().replacen("low_pass_hz", "--low-pass-hz", 1))
        }
        IdentificationError::Still { ref name, position_rad, .. } => {
            let text = error.to_string();
            let (refusal, _) = text.split_once("; ").unwrap_or((&text, ""));
            anyhow!(
                "{refusal}; lock a joint that stands still: `--lock {name}={position_rad}` for a URDF, and name the \
                 columns of the other joints with --q and --u"
            )
        }
        error => error.into(),
    }
}

fn settings(arguments: &Arguments, has_gains: bool) -> anyhow::Result<Settings> {
    const MOST_STEPS: usize = 100;

    let default = if has_gains { GAIN_DEVIATION_OF_CURRENTS } else { 0.0 };
    let gain_deviation = arguments.gain_deviation.unwrap_or(default);
    ensure!(
        (0.0..=1.0).contains(&gain_deviation),
        "--gain-deviation is {gain_deviation}, allowed: 0 to 1"
    );
    let motion_steps = arguments.motion_steps;
    ensure!(
        motion_steps <= MOST_STEPS,
        "--motion-steps is {motion_steps}, allowed: 0 to {MOST_STEPS}"
    );
    let most_delay_s = arguments.most_delay_s;
    ensure!(
        (0.0..=IdentifySpec::MOST_DELAY_S).contains(&most_delay_s),
        "--most-delay-s is {most_delay_s}, allowed: 0 to {}",
        IdentifySpec::MOST_DELAY_S
    );
    let low_pass_hz = arguments.low_pass_hz;
    Ok(Settings { low_pass_hz, motion_steps, gain_deviation, most_delay_s })
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn an_arm_that_does_not_fit_its_recordings_is_not_recommended() {
        let report = |identified_nm: f64| -> ArmReport {
            let torque = json!({"joint": 1, "deviation_nm": 2.0, "described_nm": 1.0, "identified_nm": identified_nm});
            let none: [u8; 0] = [];
            let report = json!({
                "parameters": none, "torques": [torque], "validation_torques": none, "horizons_s": none,
                "errors": none, "validation_errors": none, "warnings": none,
            });
            serde_json::from_value(report).unwrap()
        };
        let path = Path::new("found/description.json");
        let fits = closing(path, &report(0.1));
        assert!(fits.starts_with("The identified arm is found/description.json"), "{fits}");
        assert!(fits.contains("\"friction\": {}"), "{fits}");
        let refused = closing(path, &report(1.5));
        assert!(refused.starts_with("The recordings do not fit the identified arm"), "{refused}");
        assert!(refused.contains("do not use found/description.json"), "{refused}");
    }

    #[test]
    fn an_error_names_the_flags_that_were_typed() {
        let low_pass = IdentificationError::LowPass {
            recording: "a.csv".to_owned(),
            low_pass_hz: 70.0,
            rate_hz: 100.0,
            below_hz: 50.0,
        };
        let message = with_flag(low_pass).to_string();
        assert!(message.starts_with("--low-pass-hz is 70 Hz, allowed for "), "{message}");
        let still = IdentificationError::Still {
            joint: 1,
            name: "j1".to_owned(),
            position_rad: 0.1,
            range_rad: 2e-5,
            least_rad: 1e-3,
        };
        assert_eq!(
            with_flag(still).to_string(),
            "joint 1 moves by 2.00e-5 rad in all recordings, allowed: at least 0.001 rad; lock a joint that stands still: \
             `--lock j1=0.1` for a URDF, and name the columns of the other joints with --q and --u"
        );
        let other = with_flag(IdentificationError::NoRecordings).to_string();
        assert_eq!(other, "there are no recordings");
    }
}

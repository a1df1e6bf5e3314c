//! From an arm to the motion that shows its parameters, on this machine.

mod figure;
mod tables;

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};

use anyhow::{Context, ensure};
use clap::Args;
use identification::{Excitation, ExcitationError, ExcitationSettings, MotionState, excite};
use serde::Serialize;
use serde_json::json;

use crate::commands::result_folder::ResultFolder;
use crate::exit::INTERRUPTED;
use crate::kept_robot::AnyRobotArguments;
use crate::output::write_json;
use crate::progress::{self, OwnWork, ProgressCallback};

#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    robot: AnyRobotArguments,

    /// The length of the motion, s
    #[arg(long, value_name = "S", default_value_t = ExcitationSettings::default().seconds)]
    seconds: f64,

    /// Rows per second of trajectory.csv: the rate of the controller
    #[arg(long, value_name = "HZ", default_value_t = 1000.0)]
    rate_hz: f64,

    /// One over the period, Hz; the motion has a whole number of periods [default: periods of at most 30 s]
    #[arg(long, value_name = "HZ")]
    base_frequency: Option<f64>,

    /// Sines and cosines of each joint [default: up to 0.5 Hz, at least 5 and at most 15]
    #[arg(long, value_name = "N")]
    harmonics: Option<usize>,

    /// The share of every limit that stays free
    #[arg(long, value_name = "SHARE", default_value_t = ExcitationSettings::default().margin)]
    margin: f64,

    /// The height of a table in the world, m; the joints from the third on and the hand stay above it
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    table_z: Option<f64>,

    /// The least height of these joints and of the hand over the table, m
    #[arg(long, value_name = "M", default_value_t = ExcitationSettings::default().clearance_m)]
    clearance: f64,

    /// Limits of the accelerations, rad/s², one per joint [default: the highest speed in 0.5 s]
    #[arg(long, value_name = "NUMBERS", value_delimiter = ',')]
    accelerations: Option<Vec<f64>>,

    /// What an identification leaves of each torque, N·m, one number per joint [default: 0.5 % of the torque limits]
    #[arg(long, value_name = "NUMBERS", value_delimiter = ',')]
    noise_nm: Option<Vec<f64>>,

    /// How far a torque may be off by its gain, as a standard deviation; 0.15 for currents
    #[arg(long, value_name = "SHARE", default_value_t = ExcitationSettings::default().gain_deviation)]
    gain_deviation: f64,

    /// Folder for the motion; it must not exist or be empty
    #[arg(long, value_name = "DIR", default_value = "excitation")]
    out: PathBuf,

    /// Print the report as JSON
    #[arg(long)]
    json: bool,
}

pub async fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let settings = settings(arguments);
    check_rate(arguments, &settings)?;
    let robot = arguments.robot.read().await?;
    for doubt in &robot.doubts {
        eprintln!("warning: {doubt}");
    }
    let _folder = ResultFolder::prepare(&arguments.out)?;
    let (description, work) =
        (robot.description().clone(), OwnWork::search("excite", settings.steps()));
    let search = move |progress: ProgressCallback<'_>| {
        let done = AtomicU64::new(0);
        let step = |count: u64| progress(done.fetch_add(count, Ordering::Relaxed) + count);
        excite(&description, &settings, &step)
    };
    let found = progress::follow_own(work, search).await?;
    if matches!(found, Err(ExcitationError::Stopped)) {
        eprintln!("interrupted");
        return Ok(ExitCode::from(INTERRUPTED));
    }
    let found = found?;
    write(&arguments.out, arguments.rate_hz, &found)?;
    if arguments.json {
        write_json(&found.report)?;
        return Ok(ExitCode::SUCCESS);
    }
    print!("{}", tables::text(&found.report));
    println!(
        "\nThe motion is in {}: look at figure.svg, and run trajectory.csv slowly at first. Nothing but the limits and \
         the table is known here, neither the arm's own shape nor its surroundings.",
        arguments.out.display()
    );
    Ok(ExitCode::SUCCESS)
}

fn settings(arguments: &Arguments) -> ExcitationSettings {
    ExcitationSettings {
        seconds: arguments.seconds,
        base_frequency_hz: arguments.base_frequency,
        harmonics: arguments.harmonics,
        margin: arguments.margin,
        table_z_m: arguments.table_z,
        clearance_m: arguments.clearance,
        accelerations_rad_s2: arguments.accelerations.clone(),
        noise_nm: arguments.noise_nm.clone(),
        gain_deviation: arguments.gain_deviation,
        ..ExcitationSettings::default()
    }
}

/// Checks that the rows are neither too few for the motion nor too many for a file.
fn check_rate(arguments: &Arguments, settings: &ExcitationSettings) -> anyhow::Result<()> {
    const ROWS_PER_WAVE: f64 = 20.0;
    const MOST_HZ: f64 = 10_000.0;
    const MOST_ROWS: f64 = 2e6;

    settings.check()?;
    let least = ROWS_PER_WAVE * settings.harmonics() as f64 * settings.base_frequency_hz();
    let most = MOST_HZ.min(MOST_ROWS / settings.seconds);
    ensure!(
        (least..=most).contains(&arguments.rate_hz),
        "--rate-hz is {}, allowed: {least} to {most:.0} Hz for this motion",
        arguments.rate_hz
    );
    Ok(())
}

fn write(folder: &Path, rate_hz: f64, found: &Excitation) -> anyhow::Result<()> {
    let write = |name: &str, text: &str| {
        let path = folder.join(name);
        fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))
    };
    let path = folder.join("trajectory.csv");
    write_trajectory(&path, rate_hz, found)
        .with_context(|| format!("cannot write {}", path.display()))?;
    write("trajectory.json", &pretty(&trajectory(found))?)?;
    write("parameters.csv", &tables::parameters(&found.report))?;
    write("figure.svg", &figure::svg(found)?)?;
    write("report.json", &pretty(&found.report)?)
}

/// The motion for a controller that computes it itself.
fn trajectory(found: &Excitation) -> serde_json::Value {
    let report = &found.report;
    let joints = found.motion.joints.iter().zip(&report.joints).map(|(joint, of_report)| {
        json!({
            "name": of_report.name,
            "offset_rad": joint.offset_rad,
            "sine_rad": joint.sine_rad,
            "cosine_rad": joint.cosine_rad,
        })
    });
    json!({
        "formula": "q(t) = offset_rad + sum over k = 1, 2, ..: sine_rad[k - 1] sin(2 pi k f t) + cosine_rad[k - 1] cos(2 \
                    pi k f t), f = base_frequency_hz, t in s",
        "seconds": report.seconds,
        "base_frequency_hz": report.base_frequency_hz,
        "joints": joints.collect::<Vec<_>>(),
    })
}

/// Writes the motion with its torques, from its beginning to its end.
fn write_trajectory(path: &Path, rate_hz: f64, found: &Excitation) -> anyhow::Result<()> {
    let joints = found.motion.joints.len();
    let mut file = BufWriter::new(File::create(path)?);
    write!(file, "t")?;
    for column in ["q", "qd", "qdd", "u"] {
        for joint in 1..=joints {
            write!(file, ",{column}{joint}")?;
        }
    }
    writeln!(file)?;
    let seconds = found.report.seconds;
    for row in 0_u32.. {
        let time_s = (f64::from(row) / rate_hz).min(seconds);
        let state = found.motion.at(time_s);
        let torques = found.torques(&state);
        write!(file, "{time_s}")?;
        let MotionState { q, qd, qdd } = state;
        for value in [q, qd, qdd].iter().flat_map(|values| values.iter()) {
            write!(file, ",{value:.8}")?;
        }
        for torque in &torques {
            write!(file, ",{torque:.4}")?;
        }
        writeln!(file)?;
        if time_s >= seconds {
            break;
        }
    }
    Ok(file.flush()?)
}

/// A document as JSON for people to read.
fn pretty(value: &impl Serialize) -> anyhow::Result<String> {
    Ok(serde_json::to_string_pretty(value)? + "\n")
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        excite: Arguments,
    }

    #[test]
    fn an_error_of_a_setting_begins_with_the_flag_that_was_typed() {
        for (flag, value) in [
            ("--seconds", "2"),
            ("--base-frequency", "0.13"),
            ("--harmonics", "1"),
            ("--margin", "1"),
            ("--table-z", "200"),
            ("--clearance", "11"),
            ("--gain-deviation", "2"),
        ] {
            let Command { excite } = Command::parse_from(["excite", "panda", flag, value]);
            let message = settings(&excite).check().unwrap_err().to_string();
            assert!(message.starts_with(&format!("{flag} is {value}, allowed: ")), "{message}");
        }
        for flag in ["--accelerations", "--noise-nm"] {
            let Command { excite: arguments } = Command::parse_from(["excite", "panda", flag, "1"]);
            let panda = spec::RobotModel::panda();
            let unheard = |_| ControlFlow::Continue(());
            let error = excite(panda.description(), &settings(&arguments), &unheard).unwrap_err();
            assert_eq!(
                error.to_string(),
                format!("{flag} has 1 numbers, allowed: 7, one per joint")
            );
        }
    }
}

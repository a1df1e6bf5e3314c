//! Identifications: one task, which reads recordings and finds an arm.
//!
//! The result is a function of the recordings and the spec, so another attempt after a crash gives
//! the same files.

mod files;

use std::ops::ControlFlow;

use dynamics::Scenarios;
use identification::{Recording, Settings, identify, identify_load};
use spec::{DataSource, DataSources, IdentifySpec, RobotDescription, SpecError};
use store::{NewRobot, Robot, RobotSource};

use crate::attempt::Attempt;
use crate::dataset::DatasetReader;
use crate::error::TaskError;
use crate::kinds::KindModule;

use files::digest;
pub use files::{ArmFile, ArmFileError, FoundLoad, IdentifiedArm};

pub(crate) const MODULE: KindModule = KindModule { run, computes_models: false };

fn run(attempt: &Attempt) -> Result<(), TaskError> {
    let spec: IdentifySpec = attempt.spec()?;
    let described = described(&spec)?;
    let of = |field: &str, sources: Option<&DataSources>| match sources {
        Some(sources) => recordings(attempt, &spec, field, sources),
        None => Ok(Vec::new()),
    };
    let fit = of("data", Some(&spec.data))?.concat();
    let validation = of("validation", spec.validation.as_ref())?.concat();
    // Each dataset has a load of its own.
    let loaded = of("load", spec.load.as_ref())?;

    let settings = settings(&spec);
    let steps = settings.steps() + loaded.len() as u64 * settings.load_steps();
    let mut done = 0;
    let mut progress = || -> ControlFlow<()> {
        done += 1;
        // The last percent is for the files.
        attempt.show((99 * done / steps).min(99))
    };
    attempt.progress.say("fits the arm".to_owned());
    let mut found = identify(described, &fit, &validation, &settings, &mut progress)?;
    found.report.warnings.extend(about_several_arms(attempt, &spec)?);
    let fields = spec.load.iter().flat_map(|load| load.in_field("load"));
    let mut loads = Vec::new();
    for ((field, _), recordings) in fields.zip(&loaded) {
        attempt.progress.say(format!("fits the load of {field}"));
        let load = identify_load(described, &found.arm, recordings, &[], &settings, &mut progress)?;
        loads.push(FoundLoad { recordings: field, found: load });
    }
    attempt.check_stop()?;

    let kept = attempt.wait(attempt.store.robot_by_digest(digest(described)))?;
    let source = kept.as_ref().map(|robot| source(attempt, robot)).transpose()?.flatten();
    let urdf = source.as_ref().map(|(source, arm)| (source.urdf.as_str(), arm));
    let arm = IdentifiedArm { described, urdf, found: &found, loads: &loads };
    let report = arm.report();
    let warnings = reports::identification::warnings(&report);
    for warning in &warnings {
        tracing::warn!("{warning}");
    }
    for ArmFile { name, media_type, bytes } in arm.files()? {
        attempt.put(&name, media_type, bytes)?;
    }
    let options = source.as_ref().map(|(source, _)| source.options.clone());
    let robot = NewRobot {
        name: identified_name(kept.as_ref().map_or(&described.name, |robot| &robot.name)),
        description: arm.description(),
        source: arm.urdf()?.zip(options).map(|(urdf, options)| RobotSource { urdf, options }),
        doubts: warnings,
        job: Some(attempt.task.job),
        added_by: None,
    };
    let result = serde_json::to_value(&report)?;
    attempt.end(attempt.store.commit_robot(attempt.fence(), &robot, &result))
}

/// The name of the arm that was identified from a robot of this name.
fn identified_name(described: &str) -> String {
    const ENDING: &str = ", identified";

    // An identified arm may be identified again.
    format!("{}{ENDING}", described.strip_suffix(ENDING).unwrap_or(described))
}

/// The URDF of a robot that the server keeps, if it came as a URDF.
fn source(attempt: &Attempt, robot: &Robot) -> Result<Option<(RobotSource, urdf::Arm)>, TaskError> {
    let Some(source) = attempt.wait(attempt.store.robot_source(robot.id))? else {
        return Ok(None);
    };
    let options: urdf::Options = serde_json::from_value(source.options.clone())?;
    let arm = urdf::read(&source.urdf, &options).map_err(ArmFileError::from)?;
    Ok(Some((source, arm)))
}

/// A warning if the data are simulated and their arms differ.
fn about_several_arms(attempt: &Attempt, spec: &IdentifySpec) -> Result<Option<String>, TaskError> {
    for (path, source) in spec.data.in_field("data") {
        let dataset = DatasetReader::open(attempt, source)?;
        let Some(simulation) = dataset.spec.simulation().filter(|_| spec.used(dataset.count()) > 1)
        else {
            continue;
        };
        let scenarios = Scenarios::new(simulation);
        if scenarios.draw(0, 1).robot != scenarios.draw(1, 1).robot {
            return Ok(Some(format!(
                "{path} is a simulation whose arms differ, one for each trajectory: the identified arm is none of \
                 them. Use one trajectory, or recordings of one arm"
            )));
        }
    }
    Ok(None)
}

/// Submission has filled in the arm that the data name.
fn described(spec: &IdentifySpec) -> Result<&RobotDescription, TaskError> {
    let missing = || TaskError::Missing { what: "the described", name: "arm".to_owned() };
    Ok(spec.robot.as_ref().ok_or_else(missing)?.model.description())
}

fn settings(spec: &IdentifySpec) -> Settings {
    Settings {
        low_pass_hz: spec.low_pass_hz,
        motion_steps: spec.motion_steps as usize,
        gain_deviation: spec.gain_deviation,
        most_delay_s: spec.most_delay_s,
    }
}

/// The trajectories of datasets, each as a recording, `[dataset][recording]`.
fn recordings(
    attempt: &Attempt,
    spec: &IdentifySpec,
    field: &str,
    sources: &DataSources,
) -> Result<Vec<Vec<Recording>>, TaskError> {
    let open = |source: &DataSource| DatasetReader::open(attempt, source);
    let datasets = sources.each().iter().map(open).collect::<Result<Vec<_>, _>>()?;
    let used = |dataset: &DatasetReader| spec.used(dataset.count());
    let trajectories: u64 = datasets.iter().map(used).sum();
    let samples: u64 =
        datasets.iter().map(|dataset| used(dataset) * u64::from(dataset.spec.samples())).sum();
    if samples > IdentifySpec::MOST_SAMPLES {
        let most = IdentifySpec::MOST_SAMPLES;
        let found =
            format!("{trajectories} trajectories of {field} with {samples} samples together");
        let allowed = format!("at most {most} samples: use fewer trajectories");
        return Err(SpecError::one("trajectories", found, allowed).into());
    }
    let paths = sources.in_field(field).into_iter().map(|(path, _)| path);
    let read = |(dataset, path): (&DatasetReader, String)| {
        let mut recordings = recordings_of(dataset, used(dataset))?;
        if datasets.len() > 1 {
            for recording in &mut recordings {
                recording.name = format!("{} of {path}", recording.name);
            }
        }
        Ok(recordings)
    };
    datasets.iter().zip(paths).map(read).collect()
}

/// The first trajectories of a dataset, each as a recording.
fn recordings_of(dataset: &DatasetReader, used: u64) -> Result<Vec<Recording>, TaskError> {
    let names = match dataset.spec.simulation() {
        Some(_) => Vec::new(),
        None => dataset.recordings()?,
    };
    let series = dataset.read(0..used)?;
    let joints = series.joints();
    let rows = |values: &[f32]| -> Vec<Vec<f64>> {
        values
            .chunks_exact(joints)
            .map(|row| row.iter().copied().map(f64::from).collect())
            .collect()
    };
    let view = series.view();
    let recording = |at: usize| {
        let name = names.get(at).filter(|name| !name.is_empty());
        let name = name.map_or_else(|| format!("trajectory {at}"), |name| format!("{name} ({at})"));
        Recording {
            name,
            rate_hz: view.rate_hz(),
            q: rows(view.y(at).values()),
            u: rows(view.u(at).values()),
        }
    };
    Ok((0..view.robots()).map(recording).collect())
}

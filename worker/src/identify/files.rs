//! The files that an identification leaves, as a job and on the command line.

use identification::Identification;
use serde::Serialize;
use spec::{Digest, RobotDescription};
use thiserror::Error;
use wire::{ArmReport, IdentificationReport, LoadReport};

/// Why the files of an identified arm cannot be written.
#[derive(Debug, Error)]
pub enum ArmFileError {
    /// A figure cannot be drawn.
    #[error("a figure could not be drawn")]
    Figure(#[from] figures::FigureError),
    /// The arm does not fit into a URDF or a MuJoCo model.
    #[error(transparent)]
    Urdf(#[from] urdf::UrdfError),
    /// A number cannot be written as JSON.
    #[error("a result could not be written")]
    Json(#[from] serde_json::Error),
}

/// A load that was found in the hand.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundLoad {
    /// The recordings with this load, for people.
    pub recordings: String,
    /// The arm with the load.
    pub found: Identification,
}

/// An identified arm, perhaps with loads, and the arm that the search began from.
#[derive(Clone, Copy, Debug)]
pub struct IdentifiedArm<'a> {
    /// The described arm.
    pub described: &'a RobotDescription,
    /// The text of its URDF and what was read from it, if it comes from one.
    pub urdf: Option<(&'a str, &'a urdf::Arm)>,
    /// The arm that was found.
    pub found: &'a Identification,
    /// The loads.
    pub loads: &'a [FoundLoad],
}

/// A file of an identified arm.
#[derive(Clone, Debug, PartialEq)]
pub struct ArmFile {
    /// Its name, such as `arm.urdf`.
    pub name: String,
    /// Its type, as in `Content-Type`.
    pub media_type: &'static str,
    /// Its content.
    pub bytes: Vec<u8>,
}

const JSON: &str = "application/json";
const CSV: &str = "text/csv";
const SVG: &str = "image/svg+xml";
const XML: &str = "application/xml";

impl IdentifiedArm<'_> {
    /// The report on the arm and its loads.
    pub fn report(&self) -> IdentificationReport {
        IdentificationReport {
            robot: digest(&self.description()),
            arm: self.found.report.clone(),
            load: self.loads.first().map(|load| load.found.report.clone()),
            loads: self.loads.iter().map(FoundLoad::report).collect(),
        }
    }

    /// The description of the arm that was found.
    pub fn description(&self) -> RobotDescription {
        self.found.arm.description(self.described)
    }

    /// The described URDF with the identified numbers, if the arm came from one.
    ///
    /// # Errors
    /// See [`ArmFileError`].
    pub(super) fn urdf(&self) -> Result<Option<String>, ArmFileError> {
        let Some((text, arm)) = self.urdf else { return Ok(None) };
        Ok(Some(urdf::write(text, arm, &self.description())?))
    }

    /// The description, the URDF if the arm came from one, the MuJoCo model, parameters, figures
    /// and the report; for each load the arm with it and its parameters.
    ///
    /// # Errors
    /// See [`ArmFileError`].
    pub fn files(&self) -> Result<Vec<ArmFile>, ArmFileError> {
        let file = |name: &str, media_type, bytes: Vec<u8>| {
            let name = name.to_owned();
            ArmFile { name, media_type, bytes }
        };
        let identified = self.description();
        let Self { found, urdf, .. } = self;
        let mujoco = urdf::mjcf(&identified, urdf.map(|(_, arm)| arm))?;
        let parameters = reports::identification::parameters_csv(&found.report);
        let mut files = vec![
            file("report.json", JSON, pretty(&self.report())?),
            file("description.json", JSON, pretty(&identified)?),
            file("arm.xml", XML, mujoco.into_bytes()),
            file("parameters.csv", CSV, parameters.into_bytes()),
            file("torques.svg", SVG, found.curves.torques_svg()?.into_bytes()),
            file("motion.svg", SVG, found.curves.positions_svg()?.into_bytes()),
            file("curves.csv", CSV, found.curves.to_csv().into_bytes()),
        ];
        if let Some(urdf) = self.urdf()? {
            files.push(file("arm.urdf", XML, urdf.into_bytes()));
        }
        for (number, FoundLoad { found, .. }) in (1..).zip(self.loads) {
            let loaded = found.arm.description(self.described);
            let parameters = reports::identification::parameters_csv(&found.report);
            let of = |name: &str, ending: &str| match number {
                1 => format!("{name}.{ending}"),
                _ => format!("{name}-{number}.{ending}"),
            };
            files.push(file(&of("loaded", "json"), JSON, pretty(&loaded)?));
            files.push(file(&of("load", "csv"), CSV, parameters.into_bytes()));
        }
        Ok(files)
    }
}

impl FoundLoad {
    fn report(&self) -> LoadReport {
        let ArmReport { parameters, errors, warnings, .. } = &self.found.report;
        let of = |name: &str| {
            let found = parameters.iter().find(|parameter| parameter.name == name);
            found.map_or((0.0, 0.0), |parameter| (parameter.value, parameter.deviation))
        };
        let mass = of("load_mass");
        let center = ["load_center_x", "load_center_y", "load_center_z"].map(of);
        LoadReport {
            recordings: self.recordings.clone(),
            mass_kg: mass.0,
            mass_deviation_kg: mass.1,
            center_m: center.map(|(value, _)| value),
            center_deviation_m: center.map(|(_, deviation)| deviation),
            errors: errors.clone(),
            warnings: warnings.clone(),
        }
    }
}

/// The digest under which a store keeps a description.
pub(super) fn digest(description: &RobotDescription) -> Digest {
    // Numbers and texts can always be written.
    Digest::of_json(&serde_json::to_value(description).unwrap_or_default())
}

fn pretty(value: &impl Serialize) -> Result<Vec<u8>, ArmFileError> {
    Ok((serde_json::to_string_pretty(value)? + "\n").into_bytes())
}

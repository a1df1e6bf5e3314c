//! The studies: pipelines of trainings and evaluations, each made from a list.
//!
//! [`paper`] repeats the paper on its own arms (`study/paper.json`). [`real`] asks the same models
//! about arms as they are used (`study/real.json`).

mod paper;
mod plan;
mod real;
mod scale;

use crate::{Preset, PresetPlace};
pub use paper::{StudyModel, study_models};
pub use plan::{StudyEvaluation, StudyPlan, StudyQuestion, StudyTraining};
pub use real::{StudyRecording, real_study};
pub use scale::StudyScale;

/// The question that a study puts to models.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StudyEdition {
    /// The paper's question on the paper's arms: torques unlike those of the training.
    Paper,
    /// Arms as they are used: lightly damped, with friction, a controller and an unknown load.
    Real,
}

impl StudyEdition {
    /// The name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Real => "real",
        }
    }

    /// The name of the preset at a scale. `None` if the edition has no such scale.
    pub const fn preset(self, scale: StudyScale) -> Option<&'static str> {
        match (self, scale) {
            (Self::Paper, scale) => Some(scale.preset()),
            (Self::Real, StudyScale::Tiny) => Some("real-study-tiny"),
            (Self::Real, StudyScale::Small) => Some("real-study-small"),
            (Self::Real, StudyScale::Paper) => None,
        }
    }

    /// The name of a training set, counted from 1.
    pub fn set_name(self, set: usize) -> String {
        match self {
            Self::Paper => format!("D{set}"),
            Self::Real => real::arm_of_set(set).to_owned(),
        }
    }
}

impl StudyPlan {
    /// A study at a scale. An edition without that scale is planned at the next smaller one.
    pub fn of(edition: StudyEdition, scale: StudyScale) -> Self {
        match edition {
            StudyEdition::Paper => paper::plan(scale),
            StudyEdition::Real => real::plan(scale),
        }
    }

    /// Adds the evaluations of a study of real arms on an imported recording.
    pub fn add_recording(&mut self, recording: &'static StudyRecording, dataset: i64) {
        let evaluation = real::on_recording(recording, dataset, &self.trainings);
        self.evaluations.push(evaluation);
    }
}

/// The presets of the studies, with their positions in the list of all presets.
pub(crate) fn presets() -> impl Iterator<Item = (String, Preset)> {
    const PLACES: [(&str, StudyEdition, StudyScale); 5] = [
        ("040", StudyEdition::Paper, StudyScale::Tiny),
        ("050", StudyEdition::Paper, StudyScale::Small),
        ("060", StudyEdition::Paper, StudyScale::Paper),
        ("062", StudyEdition::Real, StudyScale::Tiny),
        ("064", StudyEdition::Real, StudyScale::Small),
    ];
    PLACES.into_iter().filter_map(|(place, edition, scale)| {
        let name = edition.preset(scale)?.to_owned();
        let spec = StudyPlan::of(edition, scale).pipeline(&name);
        let about = match edition {
            StudyEdition::Paper => scale.about(),
            StudyEdition::Real => real::about(scale),
        };
        let about = about.to_owned();
        Some((format!("{place}-{name}"), Preset { name, about, place: PresetPlace::Job, spec }))
    })
}

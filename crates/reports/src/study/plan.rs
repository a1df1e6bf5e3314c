//! The pipeline of a study before it runs.

use anyhow::{Context, bail};
use serde_json::json;
use spec::{JobSpec, PipelineSpec, StudyPlan, StudyScale};

/// A study that can be submitted: its pipeline, and what each job of it is for.
#[derive(Debug)]
pub struct Plan {
    /// How large its models, data and seeds are.
    pub scale: StudyScale,
    /// Its trainings and evaluations, by the names of their jobs.
    pub parts: StudyPlan,
    /// The parsed pipeline, with presets and defaults filled in.
    pub pipeline: PipelineSpec,
}

impl Plan {
    /// The study at a scale.
    ///
    /// # Errors
    /// When the preset of that scale is no valid pipeline.
    pub fn of(scale: StudyScale) -> anyhow::Result<Self> {
        let job = spec::parse(&Self::request(scale)).context("the preset of the study")?;
        let JobSpec::Pipeline(pipeline) = job else { bail!("the preset is no pipeline") };
        Ok(Self { scale, parts: StudyPlan::of(scale), pipeline })
    }

    /// The JSON that is submitted.
    pub fn request(scale: StudyScale) -> Vec<u8> {
        json!({"preset": scale.preset()}).to_string().into_bytes()
    }
}

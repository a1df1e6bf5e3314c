//! The pipeline of a study before it runs.

use anyhow::{Context, bail};
use serde_json::json;
use spec::{JobSpec, PipelineSpec, StudyPlan, StudyScale};

#[derive(Debug)]
pub struct Plan {
    pub scale: StudyScale,
    /// The purpose of each job.
    pub parts: StudyPlan,
    pub pipeline: PipelineSpec,
}

impl Plan {
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

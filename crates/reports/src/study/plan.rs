//! The pipeline of a study before it runs.

use anyhow::{Context, bail};
use clap::ValueEnum;
use serde_json::json;
use spec::{JobSpec, PipelineSpec, StudyPlan, StudyScale};

/// The scale of the study.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Scale {
    /// Every kind of job, in twenty minutes on two cores; too small for conclusions
    Tiny,
    /// Tiny models, trained long enough to compare them, in some hours on two cores
    Small,
    /// The paper's sizes
    Paper,
}

impl Scale {
    pub const fn name(self) -> &'static str {
        self.of_spec().name()
    }

    const fn of_spec(self) -> StudyScale {
        match self {
            Self::Tiny => StudyScale::Tiny,
            Self::Small => StudyScale::Small,
            Self::Paper => StudyScale::Paper,
        }
    }
}

#[derive(Debug)]
pub struct Plan {
    pub scale: Scale,
    /// The purpose of each job.
    pub parts: StudyPlan,
    pub pipeline: PipelineSpec,
}

impl Plan {
    pub fn of(scale: Scale) -> anyhow::Result<Self> {
        let job = spec::parse(&Self::request(scale)).context("the preset of the study")?;
        let JobSpec::Pipeline(pipeline) = job else { bail!("the preset is no pipeline") };
        Ok(Self { scale, parts: StudyPlan::of(scale.of_spec()), pipeline })
    }

    /// The JSON that is submitted.
    pub fn request(scale: Scale) -> Vec<u8> {
        json!({"preset": scale.of_spec().preset()}).to_string().into_bytes()
    }
}

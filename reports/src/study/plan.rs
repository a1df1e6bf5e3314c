//! The pipeline of a study before it runs.

use anyhow::{Context, bail};
use clap::ValueEnum;
use serde_json::json;
use spec::{JobSpec, PipelineSpec};

/// How much of the study is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Scale {
    /// Every job, in twenty minutes on two cores; too small to conclude from
    Tiny,
    /// Tiny models, trained for long enough to compare, in some hours on two cores
    Small,
    /// The paper's sizes
    Paper,
}

impl Scale {
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tiny => "tiny",
            Self::Small => "small",
            Self::Paper => "paper",
        }
    }

    const fn preset(self) -> &'static str {
        match self {
            Self::Tiny => "paper-study-tiny",
            Self::Small => "paper-study-small",
            Self::Paper => "paper-study",
        }
    }
}

#[derive(Debug)]
pub struct Plan {
    pub scale: Scale,
    pub pipeline: PipelineSpec,
}

impl Plan {
    pub fn of(scale: Scale) -> anyhow::Result<Self> {
        let job = spec::parse(&Self::request(scale)).context("the preset of the study")?;
        let JobSpec::Pipeline(pipeline) = job else { bail!("the preset is no pipeline") };
        Ok(Self { scale, pipeline })
    }

    /// What is submitted.
    pub fn request(scale: Scale) -> Vec<u8> {
        json!({"preset": scale.preset()}).to_string().into_bytes()
    }
}

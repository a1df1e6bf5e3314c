//! The pipeline of a study before it runs.

use anyhow::{Context, bail};
use spec::{JobSpec, PipelineSpec, StudyEdition, StudyPlan, StudyRecording, StudyScale};

/// A study that can be submitted: its pipeline, and what each job of it is for.
#[derive(Debug)]
pub struct Plan {
    /// The question that it puts to models.
    pub edition: StudyEdition,
    /// How large its models, data and seeds are.
    pub scale: StudyScale,
    /// Its trainings and evaluations, by the names of their jobs.
    pub parts: StudyPlan,
    /// The parsed pipeline, with presets and defaults filled in.
    pub pipeline: PipelineSpec,
    name: &'static str,
}

impl Plan {
    /// An edition at a scale.
    ///
    /// # Errors
    /// When the edition has no such scale, or its preset is no valid pipeline.
    pub fn of(edition: StudyEdition, scale: StudyScale) -> anyhow::Result<Self> {
        let Some(name) = edition.preset(scale) else {
            let scales = StudyScale::ALL.into_iter().filter(|it| edition.preset(*it).is_some());
            let scales: Vec<&str> = scales.map(StudyScale::name).collect();
            bail!(
                "--scale {}: the edition {} has {}",
                scale.name(),
                edition.name(),
                scales.join(" and ")
            )
        };
        let parts = StudyPlan::of(edition, scale);
        let pipeline = parsed(&parts, name)?;
        Ok(Self { edition, scale, parts, pipeline, name })
    }

    /// Asks the models about recordings, too, each with the dataset that it was imported as.
    ///
    /// # Errors
    /// When the pipeline is not valid with them.
    pub fn add_recordings(
        &mut self,
        recordings: &[(&'static StudyRecording, i64)],
    ) -> anyhow::Result<()> {
        for (recording, dataset) in recordings {
            self.parts.add_recording(recording, *dataset);
        }
        self.pipeline = parsed(&self.parts, self.name)?;
        Ok(())
    }

    /// The JSON that is submitted.
    pub fn request(&self) -> Vec<u8> {
        self.parts.pipeline(self.name).to_string().into_bytes()
    }
}

fn parsed(parts: &StudyPlan, name: &str) -> anyhow::Result<PipelineSpec> {
    let text = parts.pipeline(name).to_string();
    match spec::parse(text.as_bytes()).context("the preset of the study")? {
        JobSpec::Pipeline(pipeline) => Ok(pipeline),
        _ => bail!("the preset is no pipeline"),
    }
}

//! What a spec that was accepted makes doubtful.

use serde_json::Value;
use spec::{DataSource, DataSpec, Digest, JobSpec, TrainSpec};
use store::JobState;

use crate::app::App;
use crate::error::ApiError;

impl App {
    /// Sentences about the values of a stored spec, those of a pipeline's jobs and of streams
    /// included; none about a spec of another version.
    pub(super) async fn warnings(&self, spec: &Value) -> Result<Vec<String>, ApiError> {
        let Ok(spec) = serde_json::from_value::<JobSpec>(spec.clone()) else {
            return Ok(Vec::new());
        };
        let mut warnings: Vec<String> = spec.doubts().iter().map(ToString::to_string).collect();
        let Some(memory) = self.memory_bytes else { return Ok(warnings) };
        for (path, training) in trainings(&spec) {
            let Some(samples) = self.samples(&training.data).await? else { continue };
            let doubt = training.memory_doubt(samples, memory);
            warnings.extend(doubt.map(|doubt| format!("{path}{doubt}")));
        }
        Ok(warnings)
    }

    /// Of each trajectory; `None` when nothing is known of the data.
    async fn samples(&self, data: &DataSource) -> Result<Option<u32>, ApiError> {
        match data {
            DataSource::Stream(spec) => Ok(Some(spec.samples)),
            DataSource::Digest(digest) => self.samples_of(*digest).await,
            DataSource::Job(_) | DataSource::Dataset(_) => Ok(None),
        }
    }

    async fn samples_of(&self, digest: Digest) -> Result<Option<u32>, ApiError> {
        let job = self.store.job_by_digest(digest, &JobState::ALL).await?;
        let spec = job.and_then(|job| serde_json::from_value::<JobSpec>(job.spec).ok());
        Ok(spec.and_then(|spec| DataSpec::of(&spec)).map(|data| data.samples()))
    }
}

/// The trainings of a spec, with the path to the fields of each.
fn trainings(spec: &JobSpec) -> Vec<(String, &TrainSpec)> {
    match spec {
        JobSpec::Train(spec) => vec![(String::new(), spec)],
        JobSpec::Pipeline(pipeline) => pipeline
            .jobs
            .iter()
            .filter_map(|(name, member)| match &member.spec {
                JobSpec::Train(spec) => Some((format!("jobs.{name}."), spec)),
                _ => None,
            })
            .collect(),
        _ => Vec::new(),
    }
}

//! What a spec that was accepted makes doubtful.

use serde_json::Value;
use spec::{DataSource, DataSpec, Digest, Doubt, JobSpec, SimulateSpec, TrainSpec};
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
        let mut warnings = of_job(&spec, "");
        let Some(memory) = self.memory_bytes else { return Ok(warnings) };
        for (path, training) in trainings(&spec) {
            let Some(samples) = self.samples(&training.data).await? else { continue };
            let doubt = training.memory_doubt(samples, memory);
            warnings.extend(doubt.map(|doubt| sentence(&path, doubt)));
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

/// `path` leads to the fields of `spec` and ends in a dot, unless it is empty.
fn of_job(spec: &JobSpec, path: &str) -> Vec<String> {
    match spec {
        JobSpec::Simulate(spec) => of_simulation(spec, path),
        JobSpec::Train(spec) => of_source(&spec.data, path),
        JobSpec::Evaluate(spec) => of_source(&spec.data, path),
        JobSpec::Control(spec) => of_source(&spec.data, path),
        JobSpec::Pipeline(pipeline) => pipeline
            .jobs
            .iter()
            .flat_map(|(name, member)| of_job(&member.spec, &format!("{path}jobs.{name}.")))
            .collect(),
        JobSpec::Import(_) | JobSpec::Verify(_) => Vec::new(),
    }
}

fn of_source(source: &DataSource, path: &str) -> Vec<String> {
    match source {
        DataSource::Stream(spec) => of_simulation(spec, &format!("{path}data.stream.")),
        DataSource::Job(_) | DataSource::Dataset(_) | DataSource::Digest(_) => Vec::new(),
    }
}

fn of_simulation(spec: &SimulateSpec, path: &str) -> Vec<String> {
    spec.doubts().into_iter().map(|doubt| sentence(path, doubt)).collect()
}

fn sentence(path: &str, doubt: Doubt) -> String {
    let Doubt { field, value, reason } = doubt;
    format!("{path}{field} is {value}: {reason}")
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn of(spec: &Value) -> Vec<String> {
        let spec = spec::parse(spec.to_string().as_bytes()).unwrap();
        of_job(&spec, "")
    }

    #[test]
    fn light_damping_is_doubted_wherever_the_simulation_is() {
        let light = json!({"preset": "D1-chirp", "robot": {"damping_nm_s_rad": vec![0.5; 7]}});
        let simulation = of(&light);
        assert!(simulation[0].starts_with("robot.damping_nm_s_rad is "), "{simulation:?}");

        let jobs = json!({"fine": {"preset": "D1-chirp"}, "light": light});
        let pipeline = of(&json!({"kind": "pipeline", "name": "two", "jobs": jobs}));
        assert_eq!(pipeline[0], format!("jobs.light.{}", simulation[0]));

        let training = of(&json!({
            "kind": "train", "steps": 5, "model": {"preset": "robomorph-tiny"},
            "data": {"stream": light},
        }));
        assert_eq!(training[0], format!("data.stream.{}", simulation[0]));
    }

    #[test]
    fn no_preset_is_doubted() {
        for preset in spec::presets() {
            if let Ok(spec) = serde_json::from_value(preset.spec) {
                assert_eq!(of_job(&spec, ""), Vec::<String>::new(), "{}", preset.name);
            }
        }
    }
}

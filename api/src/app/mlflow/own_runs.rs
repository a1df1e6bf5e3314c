//! Torqued's own runs in MLflow's terms: the job's spec as params, and links to the page as tags.

use serde_json::Value;
use store::{ExperimentId, RunSummary};
use wire::JobState;

use super::{RunName, artifact_uri, own_labels};
use crate::mlflow::entities::{Pair, RunInfo, Stage};

/// The user of these runs.
const USER: &str = "torqued";

pub fn info(run: &RunSummary) -> RunInfo {
    let name = RunName::Own(run.id);
    let start = run.started_at.unwrap_or(run.created_at);
    RunInfo {
        run_id: name.to_string(),
        run_uuid: name.to_string(),
        run_name: run.name.clone(),
        experiment_id: ExperimentId::TORQUED.to_string(),
        user_id: USER.to_owned(),
        status: status(run.state),
        start_time: start.milliseconds(),
        end_time: run.finished_at.map(store::Timestamp::milliseconds),
        artifact_uri: artifact_uri(ExperimentId::TORQUED, &name),
        lifecycle_stage: Stage::Active,
    }
}

const fn status(state: JobState) -> &'static str {
    match state {
        JobState::Waiting | JobState::Queued => "SCHEDULED",
        JobState::Running => "RUNNING",
        JobState::Succeeded => "FINISHED",
        JobState::Failed => "FAILED",
        JobState::Cancelled => "KILLED",
    }
}

/// Every value of the spec under its path, such as `optimizer.learning_rate`. A list is one value,
/// as JSON.
pub fn params(spec: &Value) -> Vec<Pair> {
    let mut params = Vec::new();
    flatten(String::new(), spec, &mut params);
    params.sort_by(|a, b| a.key.cmp(&b.key));
    params
}

fn flatten(path: String, value: &Value, params: &mut Vec<Pair>) {
    match value {
        Value::Object(fields) => {
            for (name, field) in fields {
                let dot = if path.is_empty() { "" } else { "." };
                flatten(format!("{path}{dot}{name}"), field, params);
            }
        }
        Value::String(text) => params.push(Pair { key: path, value: text.clone() }),
        other => params.push(Pair { key: path, value: other.to_string() }),
    }
}

pub fn tags(run: &store::Run) -> Vec<Pair> {
    let about = format!(
        "A {} of torqued: [job {job}](/jobs/{job}), [run {id}](/runs/{id}).",
        run.kind,
        job = run.job,
        id = run.id
    );
    let mut tags = vec![
        (own_labels::NOTE, run.note.clone().unwrap_or(about)),
        (own_labels::NAME, run.name.clone()),
        ("mlflow.source.name", USER.to_owned()),
        ("mlflow.source.type", "JOB".to_owned()),
        ("mlflow.user", USER.to_owned()),
    ];
    if let Some(data) = run.spec.pointer("/data/digest").and_then(Value::as_str) {
        tags.push(("torqued.dataset", data.to_owned()));
    }
    tags.push(("torqued.digest", run.digest.to_string()));
    if let Some(error) = &run.error {
        tags.push(("torqued.error", error.clone()));
    }
    tags.extend([
        ("torqued.job", run.job.to_string()),
        ("torqued.kind", run.kind.clone()),
        ("torqued.page", format!("/runs/{}", run.id)),
    ]);
    let labels: Vec<&str> = run.tags.iter().chain(&run.job_tags).map(String::as_str).collect();
    if !labels.is_empty() {
        tags.push((own_labels::TAGS, labels.join(" ")));
    }
    let tags = tags.into_iter().map(|(key, value)| Pair { key: key.to_owned(), value });
    tags.chain(own_labels::shown(&run.tags, &run.job_tags)).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_spec_is_flat_as_params_and_loses_no_value() {
        let spec = json!({"steps": 20, "model": {"width": 16, "name": "a b"}, "robots": [1, {"x": null}], "seed": null});
        let params: Vec<(String, String)> =
            params(&spec).into_iter().map(|pair| (pair.key, pair.value)).collect();
        let expected = [
            ("model.name", "a b"),
            ("model.width", "16"),
            ("robots", "[1,{\"x\":null}]"),
            ("seed", "null"),
            ("steps", "20"),
        ];
        assert_eq!(params, expected.map(|(key, value)| (key.to_owned(), value.to_owned())));
    }
}

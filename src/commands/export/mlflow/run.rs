//! One run, written to the MLflow server or brought up to date there.

use std::collections::{BTreeMap, HashSet};

use serde::Serialize;
use serde_json::json;

use super::entities::{Pair, Run, RunData};
use super::error::MlflowError;
use super::server::MlflowServer;
use super::{files, source};
use crate::client::Client;

/// Metrics of one batch at most, and params or tags, as MLflow's servers have it.
const METRICS_PER_BATCH: usize = 1000;
const TEXTS_PER_BATCH: usize = 100;

/// Characters that MLflow's servers keep of a param, and of a tag.
const PARAM_VALUE: usize = 6000;
const TAG_VALUE: usize = 8000;

/// The tags that a run is found by: together they name one run of one server.
const RUN_TAG: &str = "torqued.run";
const CREATED_TAG: &str = "torqued.created_at";

/// All labels of a run in one tag. Each label also has its own tag.
const LABELS_TAG: &str = "torqued.tags";

/// MLflow's state of a run that has not begun.
const NOT_BEGUN: &str = "SCHEDULED";

pub struct Exporter<'a> {
    pub client: &'a Client,
    pub server: &'a MlflowServer,
    /// The id of the experiment.
    pub experiment: &'a str,
    pub files: files::Choice,
}

/// The parts of a run that were written.
#[derive(Debug, Serialize)]
pub struct Exported {
    pub run: i64,
    /// Its id in MLflow.
    pub mlflow_run: String,
    /// It was not there before.
    pub created: bool,
    pub points: usize,
    pub files: usize,
    #[serde(skip)]
    pub notes: Vec<String>,
}

/// A run that was written, or why it was left out.
pub enum Outcome {
    Exported(Exported),
    LeftOut(String),
}

impl Exporter<'_> {
    pub async fn export(&self, id: i64) -> anyhow::Result<Outcome> {
        let whole: wire::Run = self.client.get(&format!("/v1/runs/{id}")).await?;
        let run = source::run(self.client, id).await?;
        if run.info.status == NOT_BEGUN {
            let reason = format!("run {id} is {}; it is left out until it begins", whole.state);
            return Ok(Outcome::LeftOut(reason));
        }
        let names = [(RUN_TAG, id.to_string()), (CREATED_TAG, whole.created_at.clone())];
        let names = names.map(|(key, value)| Pair { key: key.to_owned(), value });
        let found = self.server.find_run(self.experiment, &names).await?;
        if let Some(deleted) = found.as_ref().filter(|run| run.info.lifecycle_stage == "deleted") {
            let reason = format!(
                "run {id} is deleted in MLflow; it is left out until its run {} is restored there",
                deleted.info.run_id
            );
            return Ok(Outcome::LeftOut(reason));
        }
        let mut notes = Vec::new();
        let created = found.is_none();
        let there = match found {
            Some(there) => there,
            None => self.create(&run, &names).await?,
        };
        let mut tags = self.tags(&run.data);
        tags.extend(names);
        self.write_texts(id, &there, &run.data.params, &tags, &mut notes).await?;
        let points = self.write_points(id, &run, &there).await?;
        let files = match self.files {
            files::Choice::Sent => files::send(self.client, self.server, &whole, &there).await?,
            files::Choice::LeftOut => 0,
        };
        // Last, so that a run that ended in MLflow is whole.
        self.server
            .update_run(&json!({
                "run_id": there.info.run_id,
                "run_name": run.info.run_name,
                "status": run.info.status,
                "end_time": run.info.end_time,
            }))
            .await?;
        let mlflow_run = there.info.run_id;
        Ok(Outcome::Exported(Exported { run: id, mlflow_run, created, points, files, notes }))
    }

    async fn create(&self, run: &Run, names: &[Pair]) -> Result<Run, MlflowError> {
        let user = run.data.tags.iter().find(|tag| tag.key == "mlflow.user");
        let new = json!({
            "experiment_id": self.experiment,
            "run_name": run.info.run_name,
            "user_id": user.map(|tag| &tag.value),
            "start_time": run.info.start_time,
            "tags": names,
        });
        self.server.create_run(&new).await
    }

    /// The run's tags, with addresses of this server in place of paths.
    fn tags(&self, data: &RunData) -> Vec<Pair> {
        let address = |path: &str| self.client.url(path);
        let outside = |Pair { key, value }: &Pair| {
            let value = match key.as_str() {
                _ if self.client.is_on_socket() => value.clone(),
                "torqued.page" => address(value),
                "mlflow.note.content" => value.replace("](/", &format!("]({}", address("/"))),
                _ => value.clone(),
            };
            Pair { key: key.clone(), value }
        };
        data.tags.iter().map(outside).collect()
    }

    /// Writes the params and tags that differ. A tag of ours that the run has lost is deleted.
    async fn write_texts(
        &self,
        id: i64,
        there: &Run,
        params: &[Pair],
        tags: &[Pair],
        notes: &mut Vec<String>,
    ) -> Result<(), MlflowError> {
        let run = &there.info.run_id;
        let params = differing(params, &there.data.params);
        let params = within(&params, PARAM_VALUE, |pair, length| {
            notes.push(format!(
                "run {id}: the param {} has {length} characters, MLflow keeps {PARAM_VALUE}; it is in {}",
                pair.key,
                files::MANIFEST
            ));
        });
        for params in params.chunks(TEXTS_PER_BATCH) {
            self.server.log_batch(&json!({"run_id": run, "params": params})).await?;
        }
        let changed = differing(tags, &there.data.tags);
        let changed = within(&changed, TAG_VALUE, |pair, length| {
            notes.push(format!(
                "run {id}: the tag {} has {length} characters, MLflow keeps {TAG_VALUE}; it is in {}",
                pair.key,
                files::MANIFEST
            ));
        });
        for tags in changed.chunks(TEXTS_PER_BATCH) {
            self.server.log_batch(&json!({"run_id": run, "tags": tags})).await?;
        }
        // The labels that an earlier export wrote.
        let labels = there.data.tags.iter().find(|tag| tag.key == LABELS_TAG);
        let labels: HashSet<&str> = labels
            .map_or("", |tag| &tag.value)
            .split_whitespace()
            .map(|label| label.split_once('=').map_or(label, |(key, _)| key))
            .collect();
        let is_lost = |tag: &&Pair| {
            (tag.key.starts_with("torqued.") || labels.contains(tag.key.as_str()))
                && !tags.iter().any(|ours| ours.key == tag.key)
        };
        for tag in there.data.tags.iter().filter(is_lost) {
            self.server.delete_tag(run, &tag.key).await?;
        }
        Ok(())
    }

    /// Writes the points that are missing; returns how many.
    async fn write_points(&self, id: i64, run: &Run, there: &Run) -> anyhow::Result<usize> {
        let known: HashSet<&str> =
            there.data.metrics.iter().map(|point| point.key.as_str()).collect();
        let mut missing = Vec::new();
        let mut written = 0;
        for metric in &run.data.metrics {
            let mut points = source::history(self.client, id, &metric.key).await?;
            if known.contains(metric.key.as_str()) {
                let there = self.server.history(&there.info.run_id, &metric.key).await?;
                let there: HashSet<_> = there.iter().map(|point| point.identity()).collect();
                points.retain(|point| !there.contains(&point.identity()));
            }
            written += points.len();
            missing.append(&mut points);
            let full = missing.len() - missing.len() % METRICS_PER_BATCH;
            let rest = missing.split_off(full);
            self.write_batches(there, &missing).await?;
            missing = rest;
        }
        self.write_batches(there, &missing).await?;
        Ok(written)
    }

    async fn write_batches(
        &self,
        there: &Run,
        points: &[super::entities::Point],
    ) -> Result<(), MlflowError> {
        for metrics in points.chunks(METRICS_PER_BATCH) {
            let batch = json!({"run_id": there.info.run_id, "metrics": metrics});
            self.server.log_batch(&batch).await?;
        }
        Ok(())
    }
}

/// The pairs that the other side lacks, or has with another value.
fn differing<'a>(ours: &'a [Pair], there: &[Pair]) -> Vec<&'a Pair> {
    let there: BTreeMap<&str, &str> =
        there.iter().map(|pair| (pair.key.as_str(), pair.value.as_str())).collect();
    ours.iter().filter(|pair| there.get(pair.key.as_str()) != Some(&pair.value.as_str())).collect()
}

/// The pairs whose values have at most `most` characters. Calls `longer` for each other pair.
fn within<'a>(
    pairs: &[&'a Pair],
    most: usize,
    mut longer: impl FnMut(&Pair, usize),
) -> Vec<&'a Pair> {
    let fits = |pair: &&&Pair| {
        let length = pair.value.chars().count();
        if length > most {
            longer(pair, length);
        }
        length <= most
    };
    pairs.iter().filter(fits).copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair(key: &str, value: &str) -> Pair {
        Pair { key: key.to_owned(), value: value.to_owned() }
    }

    #[test]
    fn only_what_is_missing_or_differs_is_written() {
        let ours = [pair("a", "1"), pair("b", "2"), pair("c", "3")];
        let there = [pair("a", "1"), pair("b", "other"), pair("foreign", "x")];
        let written: Vec<&str> =
            differing(&ours, &there).iter().map(|pair| pair.key.as_str()).collect();
        assert_eq!(written, ["b", "c"]);
    }

    #[test]
    fn a_value_is_left_out_from_the_first_character_too_many() {
        let [fits, longer] = [pair("fits", &"ä".repeat(6000)), pair("longer", &"ä".repeat(6001))];
        let mut told = Vec::new();
        let kept = within(&[&fits, &longer], PARAM_VALUE, |pair, length| {
            told.push((pair.key.clone(), length));
        });
        assert_eq!(kept, [&fits]);
        assert_eq!(told, [("longer".to_owned(), 6001)]);
    }
}

//! Experiments, which clients create and fill.

use store::{ExperimentId, TrackedExperiment};

use super::{artifact_location, experiment_id, page};
use crate::app::App;
use crate::mlflow::entities::{Experiment, Stage, View};
use crate::mlflow::filter::Filter;
use crate::mlflow::order::Order;
use crate::mlflow::{Attribute, Datum, ErrorCode, Field, MlflowError};

pub struct ExperimentSearch {
    pub filter: Filter,
    pub orders: Vec<Order>,
    pub view: View,
    pub limit: u32,
    pub skipped: usize,
}

impl App {
    pub(crate) async fn create_experiment(
        &self,
        name: &str,
        tags: &[(String, String)],
    ) -> Result<ExperimentId, MlflowError> {
        Ok(self.store.create_experiment(name, tags).await?)
    }

    pub(crate) async fn mlflow_experiment(&self, id: &str) -> Result<Experiment, MlflowError> {
        Ok(entity(self.store.experiment(experiment_id(id)?).await?))
    }

    pub(crate) async fn experiment_named(&self, name: &str) -> Result<Experiment, MlflowError> {
        Ok(entity(self.store.experiment_named(name).await?))
    }

    /// A page of experiments, and the token of the next page.
    pub(crate) async fn search_experiments(
        &self,
        search: &ExperimentSearch,
    ) -> Result<(Vec<Experiment>, Option<String>), MlflowError> {
        let mut found: Vec<ExperimentWithId> = self
            .store
            .tracked_experiments()
            .await?
            .into_iter()
            .map(ExperimentWithId::new)
            .collect();
        found.retain(|entry| {
            search.view.shows(entry.experiment.is_deleted)
                && search.filter.is_met(|field| entry.datum(field))
        });
        let last =
            [Order::descending(Attribute::CreationTime), Order::ascending(Attribute::ExperimentId)];
        found.sort_by(|a, b| {
            let orders = search.orders.iter().chain(&last);
            let compare =
                |order: &Order| order.compare(a.datum(&order.field), b.datum(&order.field));
            orders.map(compare).find(|order| order.is_ne()).unwrap_or(std::cmp::Ordering::Equal)
        });
        let (shown, next) = page(found, search.skipped, search.limit);
        Ok((shown.into_iter().map(|entry| entity(entry.experiment)).collect(), next))
    }

    pub(crate) async fn rename_experiment(&self, id: &str, name: &str) -> Result<(), MlflowError> {
        let id = experiment_id(id)?;
        refuse_own(id, "renamed")?;
        Ok(self.store.rename_experiment(id, name).await?)
    }

    pub(crate) async fn set_experiment_deleted(
        &self,
        id: &str,
        is_deleted: bool,
    ) -> Result<(), MlflowError> {
        let id = experiment_id(id)?;
        refuse_own(id, "deleted")?;
        let keep = is_deleted.then(|| self.options.keep_deleted);
        Ok(self.store.set_experiment_deleted(id, keep).await?)
    }

    /// Sets a tag. With `None`, removes it.
    pub(crate) async fn tag_experiment(
        &self,
        id: &str,
        key: &str,
        value: Option<&str>,
    ) -> Result<(), MlflowError> {
        Ok(self.store.tag_experiment(experiment_id(id)?, key, value).await?)
    }
}

/// Refuses to change the experiment of torqued's own runs.
fn refuse_own(id: ExperimentId, change: &str) -> Result<(), MlflowError> {
    if id != ExperimentId::TORQUED {
        return Ok(());
    }
    let message = format!("experiment {id} has torqued's own runs and cannot be {change}");
    Err(MlflowError::refused(ErrorCode::PermissionDenied, message))
}

/// An experiment, with its id as text.
struct ExperimentWithId {
    experiment: TrackedExperiment,
    id: String,
}

impl ExperimentWithId {
    fn new(experiment: TrackedExperiment) -> Self {
        Self { id: experiment.id.to_string(), experiment }
    }

    fn datum(&self, field: &Field) -> Option<Datum<'_>> {
        let experiment = &self.experiment;
        match field {
            Field::Tag(key) => experiment.tags.get(key).map(|value| Datum::Text(value)),
            Field::Attribute(Attribute::Name) => Some(Datum::Text(&experiment.name)),
            Field::Attribute(Attribute::ExperimentId) => Some(Datum::Text(&self.id)),
            Field::Attribute(Attribute::CreationTime) => {
                Some(Datum::moment(experiment.created_at.milliseconds()))
            }
            Field::Attribute(Attribute::LastUpdateTime) => {
                Some(Datum::moment(experiment.updated_at.milliseconds()))
            }
            _ => None,
        }
    }
}

fn entity(experiment: TrackedExperiment) -> Experiment {
    Experiment {
        experiment_id: experiment.id.to_string(),
        name: experiment.name,
        artifact_location: artifact_location(experiment.id),
        lifecycle_stage: Stage::of(experiment.is_deleted),
        creation_time: experiment.created_at.milliseconds(),
        last_update_time: experiment.updated_at.milliseconds(),
        tags: experiment.tags.into_iter().map(Into::into).collect(),
    }
}

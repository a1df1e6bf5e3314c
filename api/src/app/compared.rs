//! Runs beside each other, of torqued and of clients of MLflow.

use futures::stream::{self, StreamExt as _, TryStreamExt as _};
use reports::comparison::{self, Compared};
use spec::Digest;
use store::{CurvePoint, TrackedRun, TrackedStatus};
use wire::RunName;

use crate::app::App;
use crate::app::logged::WholeLoggedRun;
use crate::error::ApiError;

/// A run that is compared.
pub(crate) struct ComparedRun {
    /// The path of its page.
    pub href: String,
    pub compared: Compared,
    /// Whether no more values will come.
    pub has_ended: bool,
    origin: Origin,
}

enum Origin {
    Own(i64),
    Logged(TrackedRun),
}

/// Curves that are read at the same time.
const AT_ONCE: usize = 4;

impl App {
    /// # Errors
    /// When there is no such run.
    pub(crate) async fn compared_run(&self, name: &RunName) -> Result<ComparedRun, ApiError> {
        match name {
            RunName::Own(id) => {
                let run = self.run(*id).await?;
                Ok(ComparedRun {
                    href: format!("/runs/{id}"),
                    compared: Compared::from(&run),
                    has_ended: run.state.is_final(),
                    origin: Origin::Own(*id),
                })
            }
            RunName::Logged(identifier) => {
                let WholeLoggedRun { logged, params, .. } = self.logged_run(identifier).await?;
                let run = logged.run;
                let params = params.iter().map(|(key, value)| (key.as_str(), value.as_str()));
                let metrics = logged.metrics.iter().map(|it| (it.key.as_str(), it.value));
                Ok(ComparedRun {
                    href: format!("/logged/{identifier}"),
                    compared: Compared::logged(&run.name, identifier, params, metrics),
                    has_ended: !matches!(
                        run.status,
                        TrackedStatus::Running | TrackedStatus::Scheduled
                    ),
                    origin: Origin::Logged(run),
                })
            }
        }
    }

    /// The runs with the names of the jobs whose digests their specs have.
    pub(crate) async fn with_names(&self, runs: &[Compared]) -> Result<Vec<Compared>, ApiError> {
        let digests: Vec<Digest> = comparison::digests(runs).into_iter().collect();
        let names = self.store.names_of_digests(&digests).await?.into_iter().collect();
        Ok(comparison::with_names(runs, &names))
    }

    /// The curve of a metric of each run, in their order; empty of runs without it.
    pub(crate) async fn compared_curves(
        &self,
        runs: &[ComparedRun],
        key: &str,
    ) -> Result<Vec<Vec<CurvePoint>>, ApiError> {
        let curves: Vec<_> = runs.iter().map(|run| self.compared_curve(&run.origin, key)).collect();
        stream::iter(curves).buffered(AT_ONCE).try_collect().await
    }

    async fn compared_curve(
        &self,
        origin: &Origin,
        key: &str,
    ) -> Result<Vec<CurvePoint>, ApiError> {
        match origin {
            Origin::Own(id) => self.metric_points(*id, key).await,
            Origin::Logged(run) => {
                let (points, _) = self.logged_points(run, key).await?;
                let point = |point: store::TrackedMetric| {
                    let step = u64::try_from(point.step).ok()?;
                    Some(CurvePoint { step, time: point.time, value: point.value })
                };
                Ok(points.into_iter().filter_map(point).collect())
            }
        }
    }
}

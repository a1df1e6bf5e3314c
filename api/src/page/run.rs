//! The page of a training: its loss curve, its latest metrics and its checkpoints.

use std::collections::BTreeMap;

use askama::Template;
use axum::extract::State;
use axum::response::{IntoResponse, Redirect, Response};
use spec::ValidationMetric;
use wire::{Checkpoint, LatestMetric};

use crate::app::App;
use crate::extract::Path;
use crate::page::answer::{InPage, PageError, html};
use crate::page::kinds::own_page;
use crate::page::labels::Labelled;
use crate::page::lineage::Lineage;
use crate::page::parts::{Fact, JobHeader};
use crate::page::spec_text::spec_text;
use crate::page::text;

#[derive(Template)]
#[template(path = "run.html")]
struct RunPage {
    id: i64,
    job: JobHeader,
    labelled: Labelled,
    loss: String,
    metrics: Vec<Fact>,
    /// The picture of the jobs before and after it.
    lineage: Option<Lineage>,
    checkpoints: Vec<CheckpointRow>,
    spec: String,
}

struct CheckpointRow {
    id: i64,
    step: String,
    marks: String,
    rmse_deg: String,
    size: String,
    digest: String,
}

pub async fn show(
    State(app): State<App>,
    InPage(Path(id)): InPage<Path<i64>>,
) -> Result<Response, PageError> {
    let run = app.run(id).await?;
    let page = own_page(run.kind, run.job, id).map(|link| link.href);
    let page = page.unwrap_or_else(|| format!("/jobs/{}", run.job));
    if page != format!("/runs/{id}") {
        return Ok(Redirect::to(&page).into_response());
    }
    let job = app.job(run.job).await?;
    let loss = app.training_curves(id).await?.svg()?;
    let checkpoints = app.checkpoints_of_job(run.job).await?;
    let page = RunPage {
        id,
        job: JobHeader::of(&job),
        labelled: Labelled::new(
            format!("/runs/{id}"),
            &run.name,
            run.note.as_ref(),
            &run.tags,
            &run.job_tags,
        ),
        loss,
        metrics: facts(&run.metrics),
        lineage: Lineage::of(&app, &job).await?,
        checkpoints: checkpoints.iter().rev().map(CheckpointRow::from).collect(),
        spec: spec_text(&job.spec),
    };
    Ok(html(&page)?)
}

/// The latest metrics. The error in degrees, which says how good the model is, comes first.
fn facts(metrics: &BTreeMap<String, LatestMetric>) -> Vec<Fact> {
    let is_rmse = |key: &str| key == ValidationMetric::RmseDeg.key();
    let mut sorted: Vec<(&String, &LatestMetric)> = metrics.iter().collect();
    sorted.sort_by_key(|(key, _)| !is_rmse(key));
    sorted.into_iter().map(|(key, latest)| fact(key, latest)).collect()
}

fn fact(key: &str, latest: &LatestMetric) -> Fact {
    Fact::new(
        key,
        text::value(latest.value.unwrap_or(f64::NAN)),
        format!("at step {}", text::count(latest.step)),
    )
}

impl From<&Checkpoint> for CheckpointRow {
    fn from(checkpoint: &Checkpoint) -> Self {
        Self {
            id: checkpoint.id,
            step: text::count(checkpoint.step),
            marks: checkpoint.marks().join(", "),
            rmse_deg: checkpoint
                .metrics
                .get(ValidationMetric::RmseDeg.key())
                .map_or(String::new(), |value| text::value(*value)),
            size: text::size(checkpoint.files.iter().map(|file| file.size).sum()),
            digest: checkpoint.digest.short(),
        }
    }
}

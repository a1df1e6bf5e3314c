//! The page of a training: its loss curve, its latest metrics and its checkpoints.

use std::collections::BTreeMap;

use askama::Template;
use axum::extract::State;
use axum::response::{IntoResponse, Redirect, Response};
use reports::Table;
use reports::comparison::{self, Compared};
use spec::ValidationMetric;
use wire::{Checkpoint, JobState, LatestMetric};

use crate::app::logs::LogEnd;
use crate::app::{App, Paging};
use crate::extract::Path;
use crate::page::answer::{InPage, PageError, html};
use crate::page::kinds::own_page;
use crate::page::labels::Labelled;
use crate::page::lineage::Lineage;
use crate::page::parts::{Fact, JobHeader};
use crate::page::spec_text::Specification;
use crate::page::text;

/// Number of attempts that are searched for a log.
const ATTEMPTS: u32 = 50;

#[derive(Template)]
#[template(path = "run.html")]
struct RunPage {
    id: i64,
    job: JobHeader,
    labelled: Labelled,
    /// The error of its best checkpoint, in a sentence.
    answer: String,
    loss: String,
    metrics: Vec<Fact>,
    /// The last lines of the log of its newest attempt.
    log: Option<LogEnd>,
    /// The picture of the jobs before and after it.
    lineage: Option<Lineage>,
    checkpoints: Vec<CheckpointRow>,
    /// The fields of the spec.
    parameters: Table,
    spec: Specification,
}

struct CheckpointRow {
    id: i64,
    step: String,
    marks: String,
    rmse_deg: String,
    size: String,
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
    let newest = Paging { limit: ATTEMPTS, before: None };
    let attempts = app.attempts(job.id, newest).await?.attempts;
    let lineage = Lineage::of(&app, &job).await?;
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
        answer: answer(&checkpoints, job.state),
        log: app.newest_log(&job, &attempts).await?,
        loss,
        metrics: facts(&run.metrics),
        checkpoints: checkpoints.iter().rev().map(CheckpointRow::from).collect(),
        parameters: comparison::parameters(&[Compared::from(&run)], true),
        spec: Specification::new(&job.spec, lineage.as_ref()),
        lineage,
    };
    Ok(html(&page)?)
}

/// The error of the best checkpoint in a sentence; empty before there is one with an error.
fn answer(checkpoints: &[Checkpoint], state: JobState) -> String {
    let rmse =
        |checkpoint: &Checkpoint| checkpoint.metrics.get(ValidationMetric::RmseDeg.key()).copied();
    let known = checkpoints.iter().filter_map(|checkpoint| Some((checkpoint, rmse(checkpoint)?)));
    let Some((best, rmse_deg)) = known.min_by(|(_, a), (_, b)| a.total_cmp(b)) else {
        return String::new();
    };
    let so_far = if state.is_final() { "" } else { " so far" };
    format!(
        "The best checkpoint of {} has a validation RMSE of {}°{so_far}, at step {}.",
        best.architecture,
        text::degrees(rmse_deg),
        text::count(best.step),
    )
}

/// The latest metrics. The error in degrees, which says how good the model is, comes first.
fn facts(metrics: &BTreeMap<String, LatestMetric>) -> Vec<Fact> {
    let is_rmse = |key: &str| key == ValidationMetric::RmseDeg.key();
    let mut sorted: Vec<(&String, &LatestMetric)> = metrics.iter().collect();
    sorted.sort_by_key(|(key, _)| !is_rmse(key));
    sorted.into_iter().map(|(key, latest)| fact(key, latest)).collect()
}

fn fact(key: &str, latest: &LatestMetric) -> Fact {
    let value = latest.value.unwrap_or(f64::NAN);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a number of bytes"
    )]
    let shown = match key.ends_with("_bytes") && value >= 0.0 {
        true => text::size(value as u64),
        false => text::value(value),
    };
    Fact::new(key, shown, format!("at step {}", text::count(latest.step)))
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
        }
    }
}

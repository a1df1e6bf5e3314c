//! An evaluation: its figure, and its numbers with their intervals.

use askama::Template;
use axum::extract::State;
use axum::response::Response;

use crate::app::{App, CellTask, JobState};
use crate::extract::Path;
use crate::page::parts::{Bar, when};
use crate::page::report::ReportView;
use crate::page::spec_text::spec_text;
use crate::page::{InPage, PageError, html, text};

#[derive(Template)]
#[template(path = "evaluation.html")]
struct EvaluationPage {
    id: i64,
    run: i64,
    name: String,
    state: JobState,
    when: String,
    settled: bool,
    can_cancel: bool,
    error: String,
    progress: Option<Bar>,
    report: Option<ReportView>,
    has_figure: bool,
    artifacts: Vec<ArtifactLink>,
    cells: Vec<CellTask>,
    spec: String,
}

struct ArtifactLink {
    url: String,
    name: String,
    size: String,
}

pub async fn show(
    State(app): State<App>,
    InPage(Path(id)): InPage<Path<i64>>,
) -> Result<Response, PageError> {
    let evaluation = app.evaluation(id).await?;
    let job = app.job(id).await?;
    let report = evaluation.read_report();
    let page = EvaluationPage {
        id,
        run: evaluation.run,
        name: job.name.clone(),
        state: job.state,
        when: when(&job),
        settled: job.state.is_final(),
        can_cancel: !job.state.is_final(),
        error: job.error.clone().unwrap_or_default(),
        progress: Bar::of(job.state, &job.progress),
        report: report.as_ref().map(ReportView::new),
        has_figure: evaluation.artifacts.iter().any(|artifact| artifact.name == "rmse.svg"),
        artifacts: evaluation
            .artifacts
            .into_iter()
            .map(|artifact| ArtifactLink {
                url: artifact.url,
                name: artifact.name,
                size: text::size(artifact.size),
            })
            .collect(),
        cells: evaluation.cells,
        spec: spec_text(&job.spec),
    };
    Ok(html(&page)?)
}

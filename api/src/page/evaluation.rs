//! The page of an evaluation: its figures, and its numbers with their intervals.

use askama::Template;
use axum::extract::State;
use axum::response::Response;
use reports::Table;
use wire::{Artifact, CellTask, ItemKind, Report, Warning, WorstCase};

use crate::app::App;
use crate::extract::Path;
use crate::page::answer::{InPage, PageError, html};
use crate::page::labels::Labelled;
use crate::page::lineage::Lineage;
use crate::page::parts::{FileLink, JobHeader};
use crate::page::predict::Viewers;
use crate::page::predictions::Drawn;
use crate::page::spec_text::Specification;

#[derive(Template)]
#[template(path = "evaluation.html")]
struct EvaluationPage {
    id: i64,
    job: JobHeader,
    labelled: Labelled,
    report: Option<ReportView>,
    /// Single predictions beside the truth.
    drawn: Option<Drawn>,
    /// The picture of the jobs before and after it.
    lineage: Option<Lineage>,
    figures: Vec<FigureView>,
    artifacts: Vec<FileLink>,
    cells: Vec<CellTask>,
    spec: Specification,
}

/// The report in sentences and tables.
struct ReportView {
    /// The result in a few sentences.
    answer: String,
    setting: String,
    /// Sentences about predictors without some answers.
    failures: Vec<String>,
    /// Sentences about data outside the checkpoints' training data.
    warnings: Vec<String>,
    /// The errors of all predictors.
    first: Option<Table>,
    /// All other tables.
    others: Vec<Table>,
}

impl ReportView {
    fn new(report: &Report, viewers: Option<&Viewers>) -> Self {
        let report = &reports::evaluation::ranked(report);
        let view = |case: &WorstCase| viewers?.address(case.trajectory, case.position_noise_rad);
        let mut tables = reports::evaluation::tables(report, view).into_iter();
        Self {
            answer: reports::evaluation::answer(report),
            setting: reports::evaluation::setting(report),
            failures: reports::evaluation::failures(report),
            warnings: Warning::sentences(&report.warnings, report.scenarios(), "scenarios"),
            first: tables.next(),
            others: tables.collect(),
        }
    }
}

/// A figure among the artifacts.
struct FigureView {
    url: String,
    title: String,
    alt: String,
}

pub async fn show(
    State(app): State<App>,
    InPage(Path(id)): InPage<Path<i64>>,
) -> Result<Response, PageError> {
    let evaluation = app.evaluation(id).await?;
    let job = app.job(id).await?;
    let drawn = app.drawn_predictions(evaluation.run).await?;
    let viewers = match &drawn {
        Some(drawn) => Viewers::of(&app, &job, drawn).await?,
        None => None,
    };
    let viewers = viewers.as_ref();
    let lineage = Lineage::of(&app, &job).await?;
    let page = EvaluationPage {
        id,
        job: JobHeader {
            // Its list, its lineage and its run have this name, too.
            name: app.name_of(ItemKind::Run, evaluation.run).await?,
            ..JobHeader::of(&job)
        },
        labelled: Labelled::of_job(&job),
        report: evaluation.report.as_ref().map(|report| ReportView::new(report, viewers)),
        drawn: drawn.map(|drawn| Drawn::new(evaluation.run, &drawn, viewers)),
        figures: figures(&evaluation.artifacts),
        artifacts: evaluation.artifacts.into_iter().map(FileLink::from).collect(),
        cells: evaluation.cells,
        spec: Specification::new(&job.spec, lineage.as_ref()),
        lineage,
    };
    Ok(html(&page)?)
}

/// The figures about all scenarios.
fn figures(artifacts: &[Artifact]) -> Vec<FigureView> {
    artifacts
        .iter()
        .filter_map(|artifact| {
            let name = artifact.name.strip_suffix(".svg")?;
            let (kind, of) = name.split_once('-').unwrap_or((name, ""));
            if kind == "prediction" {
                return None;
            }
            let what = match kind {
                "rmse" => "RMSE in degrees of each predictor over the frequency",
                "crps" => "CRPS in degrees of each predictor with samples over the frequency",
                "horizon" => "RMSE in degrees of each predictor at each step of the horizon",
                "steps" => "RMSE in degrees over the steps of the sampler, by what it starts with",
                "calibration" => {
                    "Share of positions inside central intervals over their probability"
                }
                "latency" => "Time of one prediction over the steps of the sampler",
                _ => "A figure",
            };
            let of =
                if of.is_empty() { String::new() } else { format!(", {}", of.replace('-', " ")) };
            let title = format!("{what}{of}");
            let alt = format!("{title}. The file with .csv in its name holds the same numbers.");
            Some(FigureView { url: artifact.url.clone(), title, alt })
        })
        .collect()
}

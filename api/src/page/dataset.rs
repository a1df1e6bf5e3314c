//! The page of a dataset: its contents, single trajectories, its files, and how to read them.

use askama::Template;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Redirect, Response};
use reports::Table;
use serde::Deserialize;
use spec::JobKind;
use wire::{Dataset, DatasetFile, DatasetState, FileKind, Job, JobState};

use crate::app::App;
use crate::app::datasets::data_of;
use crate::extract::{Path, Query};
use crate::page::answer::{InPage, PageError, html};
use crate::page::follow_up;
use crate::page::labels::Labelled;
use crate::page::lineage::Lineage;
use crate::page::parts::{Commands, Fact, FileRow, JobHeader, Link, Snippet};
use crate::page::recordings::Imported;
use crate::page::spec_text::Specification;
use crate::page::verification::Checked;
use crate::page::viewer::Viewer;
use crate::page::{recordings, text};

#[derive(Deserialize)]
pub struct View {
    /// The trajectory in the viewer. Default: the first one.
    trajectory: Option<u64>,
}

#[derive(Template)]
#[template(path = "dataset.html")]
struct DatasetPage {
    id: i64,
    job: JobHeader,
    /// Its state in words, as in the list, and the state of a job that has the same colour.
    state: String,
    colour: JobState,
    labelled: Labelled,
    settled: bool,
    digest: String,
    short_digest: String,
    /// That its job failed or was cancelled, in words.
    unfinished: String,
    /// Its contents in a sentence; empty before the first trajectory.
    answer: String,
    warnings: Vec<String>,
    facts: Vec<Fact>,
    /// Whether it can be verified.
    complete: bool,
    /// Jobs that go on from it.
    follow_ups: Vec<Link>,
    checked: Checked,
    /// Torques beside the robot's, and the parameters of arms.
    tables: Vec<Table>,
    /// The channels; none before the first shard.
    folded: Option<Table>,
    has_spectra: bool,
    /// A sentence about trajectories that the channels do not cover.
    left_out: String,
    viewer: Option<Viewer>,
    /// The picture of the jobs before and after it.
    lineage: Option<Lineage>,
    files: Vec<FileRow>,
    files_left_out: usize,
    snippets: Vec<Snippet>,
    spec: Specification,
}

/// Number of files shown. A link leads to the others.
const FILES: usize = 101;

pub async fn show(
    State(app): State<App>,
    InPage(Path(id)): InPage<Path<i64>>,
    InPage(Query(view)): InPage<Query<View>>,
    headers: HeaderMap,
) -> Result<Response, PageError> {
    let dataset = app.dataset(id).await?;
    let job = app.job(dataset.job).await?;
    let summary = app.summary(id).await?;
    let checked = Checked::new(dataset.verification.as_ref());
    let mut facts = facts(&dataset, job.kind, summary.trajectories);
    let mut warnings = job.warnings.clone();
    let mut tables = Vec::new();
    if job.kind == JobKind::Import
        && let Some(Imported { counts, check }) = Imported::of(&app, &job).await?
    {
        facts.extend(recordings::facts(&counts));
        warnings.extend(counts.warnings);
        let table = check.as_ref().map(reports::log_check::table);
        tables.extend(table.filter(|table| !table.rows.is_empty()));
    }
    tables.extend(reports::channels::arms(&summary));
    let channels = reports::channels::table(&summary);
    let lineage = Lineage::of(&app, &job).await?;
    let (state, colour) = state(&dataset, &job);
    let page = DatasetPage {
        id,
        job: JobHeader::of(&job),
        state,
        colour,
        labelled: Labelled::new(
            format!("/datasets/{id}"),
            &dataset.name,
            dataset.note.as_ref(),
            &dataset.tags,
            &dataset.job_tags,
        ),
        settled: job.state.is_final() && checked.settled,
        digest: dataset.digest.to_string(),
        short_digest: dataset.digest.short(),
        unfinished: unfinished(&job),
        answer: answer(&dataset, job.kind, summary.trajectories),
        warnings,
        facts,
        complete: dataset.completed_at.is_some(),
        follow_ups: match dataset.completed_at {
            Some(_) => follow_up::of_dataset(&dataset),
            None => Vec::new(),
        },
        checked,
        tables,
        folded: Some(channels).filter(|table| !table.rows.is_empty()),
        has_spectra: summary.spectra.iter().any(|spectrum| spectrum.density.len() > 1),
        left_out: match summary.trajectories - summary.summarized.min(summary.trajectories) {
            0 => String::new(),
            1 => "1 trajectory is not among them".to_owned(),
            left_out => format!("{} trajectories are not among them", text::count(left_out)),
        },
        viewer: Viewer::new(&app, &dataset, &summary, view.trajectory).await?,
        files: dataset.files.iter().take(FILES).map(FileRow::of_dataset).collect(),
        files_left_out: dataset.files.len().saturating_sub(FILES),
        snippets: snippets(&Commands::new(&headers), &dataset),
        spec: Specification::new(&job.spec, lineage.as_ref()),
        lineage,
    };
    Ok(html(&page)?)
}

/// The state of a dataset in words, and its colour. One that is being made has its job's.
fn state(dataset: &Dataset, job: &Job) -> (String, JobState) {
    match dataset.state {
        DatasetState::Abandoned => (format!("{} {}", filling(job.kind), job.state), job.state),
        DatasetState::Building if job.state != JobState::Running => {
            (job.state.to_string(), job.state)
        }
        state => (state.to_string(), state.colour()),
    }
}

/// Queues a verification, and leads back to the place of its result.
pub async fn verify(
    State(app): State<App>,
    InPage(Path(id)): InPage<Path<i64>>,
) -> Result<Response, PageError> {
    app.verify(id).await?;
    Ok(Redirect::to(&format!("/datasets/{id}#verification")).into_response())
}

/// A sentence about the job of a dataset that will never be complete; empty for other datasets.
fn unfinished(job: &Job) -> String {
    let filling = filling(job.kind);
    match (job.state, job.error.as_deref()) {
        (JobState::Failed, Some(error)) => {
            // An import has one task, of that name.
            let reason = error.strip_prefix("import: ").unwrap_or(error);
            format!("The {filling} failed: {reason}")
        }
        (JobState::Failed, None) => format!("The {filling} failed."),
        (JobState::Cancelled, _) => format!("The {filling} was cancelled."),
        _ => String::new(),
    }
}

/// The contents of a dataset in a sentence or two. Empty while there is no trajectory.
fn answer(dataset: &Dataset, kind: JobKind, trajectories: u64) -> String {
    if trajectories == 0 {
        return String::new();
    }
    let so_far = match dataset.trajectories {
        all if all > trajectories => format!(" of {}", text::count(all)),
        _ => String::new(),
    };
    let arms = if kind == JobKind::Import { "recorded" } else { "simulated" };
    let joints = data_of(&dataset.spec)
        .map_or(String::new(), |data| format!(" with {}", text::counted(data.joints(), "joint")));
    let rate = dataset.spec["rate_hz"].as_f64().unwrap_or(f64::NAN);
    let seconds = f64::from(dataset.samples) / rate;
    let plural = if trajectories == 1 { "y" } else { "ies" };
    let contents = format!(
        "{}{so_far} trajector{plural} of {arms} arms{joints}, {} s each at {} Hz.",
        text::count(trajectories),
        text::value(seconds),
        text::value(rate),
    );
    match dataset.rejected {
        0 => contents,
        refused => {
            let drawn = text::counted(trajectories + refused, "draw");
            format!("{contents} {} of {drawn} were refused.", text::count(refused))
        }
    }
}

/// The share of draws that were kept, in percent, without hiding that some were not.
fn kept(trajectories: u64, rejected: u64) -> String {
    let drawn = trajectories + rejected;
    if drawn == 0 || rejected == 0 {
        return "all".to_owned();
    }
    let percent = 100.0 * trajectories as f64 / drawn as f64;
    format!("{} %", text::value(percent.min(99.99)))
}

/// The source of a dataset, in a word.
pub fn filling(kind: JobKind) -> &'static str {
    if kind == JobKind::Import { "import" } else { "simulation" }
}

fn facts(dataset: &Dataset, kind: JobKind, trajectories: u64) -> Vec<Fact> {
    let shards = dataset.files.iter().filter(|file| file.content == FileKind::Trajectories);
    let recorded = kind == JobKind::Import;
    let rate = dataset.spec["rate_hz"].as_f64().unwrap_or(f64::NAN);
    let seconds = f64::from(dataset.samples) / rate;
    let of_all = match dataset.trajectories {
        0 => String::new(),
        all if all == trajectories => {
            (if recorded { "cut from recordings" } else { "one robot each" }).to_owned()
        }
        all => format!("of {}", text::count(all)),
    };
    let length = format!("at {} Hz: {} s each", text::value(rate), text::value(seconds));
    let mut facts = vec![
        Fact::new("Trajectories", text::count(trajectories), of_all),
        Fact::new("Samples", text::count(dataset.samples.into()), length),
        Fact::new("Shards", text::count(shards.count() as u64), "finished"),
        Fact::new("Size", text::size(dataset.bytes), "Parquet, zstd"),
    ];
    if !recorded {
        let is_controlled = dataset.spec["controller"].is_object();
        let why = if is_controlled {
            "near limits, off their reference or with an unstable controller"
        } else {
            "near limits"
        };
        let again = format!("{} drawn again, {why}", text::count(dataset.rejected));
        facts.push(Fact::new("Draws kept", kept(trajectories, dataset.rejected), again));
    }
    facts
}

impl FileRow {
    fn of_dataset(file: &DatasetFile) -> Self {
        let rows = |one: &str| text::counted(file.rows.unwrap_or(0), one);
        Self {
            url: file.url.clone(),
            name: file.name.clone(),
            contents: match file.content {
                FileKind::Description => "columns, units, counts, digests, spec".to_owned(),
                FileKind::Trajectories => rows("sample"),
                FileKind::Robots => format!("{}: what made each", rows("trajectory")),
            },
            size: text::size(file.size),
            sha256: file.sha256.to_string(),
        }
    }
}

/// How to read a dataset: in the shell and in Python, complete lines. Nothing until the first shard
/// exists.
fn snippets(commands: &Commands, dataset: &Dataset) -> Vec<Snippet> {
    if !dataset.files.iter().any(|file| file.content == FileKind::Trajectories) {
        return Vec::new();
    }
    let id = dataset.id;
    let beyond = data_of(&dataset.spec).map_or(7, |data| data.joints()) + 1;
    let polars = format!(
        "import polars as pl\n\n\
         samples = pl.read_parquet(\"dataset-{id}/trajectories-*.parquet\")  # a row per time step: u1, … in N·m, q1, … in rad\n\
         robots = pl.read_parquet(\"dataset-{id}/robots-*.parquet\")  # a row per trajectory: its robot and excitation\n\
         first = samples.filter(pl.col(\"trajectory\") == 0)\n\
         u = first.select(f\"u{{j}}\" for j in range(1, {beyond})).to_numpy()  # [time, joint]\n\
         q = first.select(f\"q{{j}}\" for j in range(1, {beyond})).to_numpy()  # [time, joint]"
    );
    vec![commands.download("dataset", id), Snippet { title: "Read it", text: polars }]
}

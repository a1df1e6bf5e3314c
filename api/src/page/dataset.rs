//! A dataset: its files, and how to read them.

use askama::Template;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;

use crate::app::{App, Dataset, DatasetFile, FileContent, JobState};
use crate::extract::Path;
use crate::page::parts::{Commands, Fact, FileRow, when};
use crate::page::spec_text::spec_text;
use crate::page::{InPage, PageError, html, text};

#[derive(Template)]
#[template(path = "dataset.html")]
struct DatasetPage {
    id: i64,
    job: i64,
    job_name: String,
    state: JobState,
    when: String,
    settled: bool,
    digest: String,
    short_digest: String,
    facts: Vec<Fact>,
    files: Vec<FileRow>,
    snippet: Option<String>,
    spec: String,
}

pub async fn show(
    State(app): State<App>,
    InPage(Path(id)): InPage<Path<i64>>,
    headers: HeaderMap,
) -> Result<Response, PageError> {
    let dataset = app.dataset(id).await?;
    let job = app.job(dataset.job).await?;
    let page = DatasetPage {
        id,
        job: job.id,
        job_name: job.name.clone(),
        state: job.state,
        when: when(&job),
        settled: job.state.is_final(),
        digest: dataset.digest.to_string(),
        short_digest: dataset.digest.short(),
        facts: facts(&dataset),
        files: dataset.files.iter().map(FileRow::of_dataset).collect(),
        snippet: snippet(&Commands::new(&app, &headers), &dataset),
        spec: spec_text(&job.spec),
    };
    Ok(html(&page)?)
}

fn facts(dataset: &Dataset) -> Vec<Fact> {
    let shards = dataset.files.iter().filter(|file| file.content == FileContent::Trajectories);
    vec![
        Fact::new("Trajectories", text::count(dataset.trajectories), "one robot each"),
        Fact::new("Samples", text::count(dataset.samples.into()), "per trajectory"),
        Fact::new("Shards", text::count(shards.count() as u64), "finished"),
        Fact::new("Size", text::size(dataset.bytes), "Parquet, zstd"),
        Fact::new("Drawn again", text::count(dataset.rejected), "trajectories at joint limits"),
    ]
}

impl FileRow {
    fn of_dataset(file: &DatasetFile) -> Self {
        let what = match file.content {
            FileContent::Trajectories => "samples",
            FileContent::Robots => "robots",
        };
        Self {
            url: file.url.clone(),
            name: file.name.clone(),
            contents: format!("{} {what}", text::count(file.rows)),
            size: text::size(file.size),
            sha256: file.sha256.to_string(),
        }
    }
}

/// Lines that work as printed once the first shard exists, in a shell and then in Python.
fn snippet(commands: &Commands, dataset: &Dataset) -> Option<String> {
    let of = |content: FileContent| dataset.files.iter().find(|file| file.content == content);
    let (samples, robots) = (of(FileContent::Trajectories)?, of(FileContent::Robots)?);
    Some(format!(
        "{}\n{}\n\n\
         import polars as pl\n\n\
         samples = pl.read_parquet(\"{}\")  # a row per time step: u1..u7 in N·m, q1..q7 in rad\n\
         robots = pl.read_parquet(\"{}\")  # a row per trajectory: its robot and excitation\n\
         first = samples.filter(pl.col(\"trajectory\") == samples[\"trajectory\"][0])\n\
         u = first.select(f\"u{{j}}\" for j in range(1, 8)).to_numpy()  # [time, joint]\n\
         q = first.select(f\"q{{j}}\" for j in range(1, 8)).to_numpy()  # [time, joint]",
        commands.download(&samples.url, &samples.name),
        commands.download(&robots.url, &robots.name),
        samples.name,
        robots.name,
    ))
}

//! The page of a checkpoint: its files, and how to open them in other tools.

use askama::Template;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use wire::{Checkpoint, StoredFile};

use crate::app::App;
use crate::app::checkpoints::Extents;
use crate::extract::Path;
use crate::page::answer::{InPage, PageError, html};
use crate::page::labels::Labelled;
use crate::page::lineage::Lineage;
use crate::page::parts::{Commands, Fact, FileRow};
use crate::page::predictions::{Drawn, DrawnFigure};
use crate::page::spec_text::spec_text;
use crate::page::text;

#[derive(Template)]
#[template(path = "checkpoint.html")]
struct CheckpointPage {
    id: i64,
    job: i64,
    job_name: String,
    labelled: Labelled,
    run: i64,
    step: String,
    marks: String,
    aliases: Vec<String>,
    metrics: Vec<Fact>,
    architecture: String,
    digest: String,
    short_digest: String,
    /// The picture of the jobs before and after it.
    lineage: Option<Lineage>,
    files: Vec<FileRow>,
    snippet: String,
    question: Option<String>,
    /// A prediction of the newest evaluation that drew one, and that evaluation.
    drawn: Option<DrawnFigure>,
    evaluation: i64,
    spec: String,
}

pub async fn show(
    State(app): State<App>,
    InPage(Path(id)): InPage<Path<i64>>,
    headers: HeaderMap,
) -> Result<Response, PageError> {
    let checkpoint = app.checkpoint(id).await?;
    let job = app.job(checkpoint.job).await?;
    let extents = app.checkpoint_extents(id).await?;
    let commands = Commands::new(&headers);
    let newest = app.drawn_of_checkpoint(&checkpoint).await?;
    let drawn = newest.as_ref().and_then(|(job, drawn)| Drawn::typical(job.run?, drawn));
    let page = CheckpointPage {
        id,
        job: job.id,
        job_name: job.name.clone(),
        labelled: Labelled {
            aliases: Some(checkpoint.aliases.join(" ")),
            ..Labelled::new(
                format!("/checkpoints/{id}"),
                checkpoint.name.as_deref().unwrap_or_default(),
                checkpoint.note.as_ref(),
                &checkpoint.tags,
                &checkpoint.job_tags,
            )
        },
        aliases: checkpoint.aliases.clone(),
        run: checkpoint.run,
        step: text::count(checkpoint.step),
        marks: checkpoint.marks().join(", "),
        metrics: facts(&checkpoint),
        snippet: snippet(&commands, &checkpoint.files),
        drawn,
        lineage: Lineage::of(&app, &job).await?,
        evaluation: newest.map_or(0, |(job, _)| job.id),
        question: extents.map(|extents| question(&commands, id, extents)),
        architecture: checkpoint.architecture,
        digest: checkpoint.digest.to_string(),
        short_digest: checkpoint.digest.short(),
        files: checkpoint.files.iter().map(FileRow::of_checkpoint).collect(),
        spec: spec_text(&job.spec),
    };
    Ok(html(&page)?)
}

fn facts(checkpoint: &Checkpoint) -> Vec<Fact> {
    let fact = |(key, value): (&String, &f64)| Fact::new(key, text::value(*value), String::new());
    checkpoint.metrics.iter().map(fact).collect()
}

impl FileRow {
    fn of_checkpoint(file: &StoredFile) -> Self {
        let contents = match file.name.rsplit_once('.') {
            Some((_, "safetensors")) => "tensors",
            Some((_, "json")) => "configuration",
            _ => "",
        };
        Self {
            url: file.url.clone(),
            name: file.name.clone(),
            contents: contents.to_owned(),
            size: text::size(file.size),
            sha256: file.sha256.to_string(),
        }
    }
}

/// A complete command that predicts for an arm at rest that will be pushed.
fn question(commands: &Commands, id: i64, Extents { context, horizon }: Extents) -> String {
    let Commands { curl, origin } = commands;
    format!(
        "python3 -c 'import json; print(json.dumps({{\"scenarios\": [{{\
         \"u\": [[0] * 7] * {context}, \"y\": [[0] * 7] * {context}, \
         \"future_u\": [[1] * 7] * {horizon}}}]}}))' |\n\
         {curl} --json @- {origin}/v1/checkpoints/{id}/predict"
    )
}

/// Complete lines for a shell and then for Python.
fn snippet(commands: &Commands, files: &[StoredFile]) -> String {
    let downloads: Vec<String> =
        files.iter().map(|file| commands.download(&file.url, &file.name)).collect();
    let model = files.iter().find(|file| file.name.starts_with("model."));
    let model = model.map_or("model.safetensors", |file| file.name.as_str());
    format!(
        "{}\n\n\
         from safetensors.torch import load_file\n\n\
         weights = load_file(\"{model}\")  # name -> torch.Tensor\n\
         for name, tensor in weights.items():\n    print(name, tuple(tensor.shape))",
        downloads.join("\n"),
    )
}

use std::io::Read;
use std::process::ExitCode;

use anyhow::{Context, ensure};
use clap::Args;
use wire::{LabelChange, TextChange};

use crate::arguments::{OutputArguments, ServerArguments};
use crate::resource::{Reference, Resource};

#[derive(Debug, Args)]
pub struct Arguments {
    /// The kind of thing; an evaluation has the labels of its job
    #[arg(value_name = "KIND")]
    resource: Resource,

    /// Its id, or the alias of a checkpoint
    #[arg(value_name = "ID")]
    id: Reference,

    #[command(flatten)]
    changes: Changes,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

#[derive(Debug, Args)]
#[group(required = true, multiple = true)]
struct Changes {
    /// Its name; an empty name removes it
    #[arg(long, value_name = "NAME")]
    name: Option<String>,

    /// A note in Markdown; - reads standard input, and an empty note removes it
    #[arg(long, value_name = "TEXT")]
    note: Option<String>,

    /// Add a tag
    #[arg(long = "tag", value_name = "TAG")]
    tags: Vec<String>,

    /// Remove a tag
    #[arg(long = "remove-tag", value_name = "TAG")]
    remove_tags: Vec<String>,

    /// Let a name, such as champion, stand for this checkpoint; another that has it loses it
    #[arg(long = "alias", value_name = "ALIAS")]
    aliases: Vec<String>,

    /// Remove an alias of this checkpoint
    #[arg(long = "remove-alias", value_name = "ALIAS")]
    remove_aliases: Vec<String>,
}

/// The largest number of bytes to read: the server's limit for a note, and one more to detect a
/// longer one.
const READ_BYTES: u64 = api::limits::NOTE_BYTES as u64 + 1;

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let Arguments { resource, id, changes, .. } = arguments;
    let Changes { name, note, tags, remove_tags, aliases, remove_aliases } = changes;
    let note = match note {
        Some(dash) if dash == "-" => Some(read_note()?),
        note => note,
    };
    let change = LabelChange {
        name: text(name),
        note: text(note),
        tags: None,
        add_tags: tags,
        remove_tags,
        add_aliases: aliases,
        remove_aliases,
    };
    let labelled = match resource {
        Resource::Evaluation => Resource::Job,
        other => other,
    };
    let answer = arguments.server.client()?.label(&labelled.api_path(id), &change).await?;
    if arguments.output.json {
        println!("{answer}");
    } else {
        print!("{}", super::show::text(labelled, &answer)?);
    }
    Ok(ExitCode::SUCCESS)
}

fn text(given: Option<String>) -> TextChange {
    match given {
        None => TextChange::Nothing,
        Some(text) if text.is_empty() => TextChange::Remove,
        Some(text) => TextChange::Set(text),
    }
}

fn read_note() -> anyhow::Result<String> {
    let mut note = String::new();
    std::io::stdin()
        .take(READ_BYTES)
        .read_to_string(&mut note)
        .context("cannot read standard input")?;
    let bytes = note.trim_end().len() as u64;
    ensure!(bytes < READ_BYTES, "the note is too long, allowed: {} bytes", api::limits::NOTE_BYTES);
    Ok(note.trim_end().to_owned())
}

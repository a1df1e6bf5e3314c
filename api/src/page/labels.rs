//! Name, note and tags of a thing: shows them, and changes them by a form.

use axum::extract::State;
use axum::response::Redirect;
use axum::routing::{MethodRouter, post};
use serde::Deserialize;
use wire::{ItemKind, Job, LabelChange, TextChange};

use crate::app::App;
use crate::error::ApiError;
use crate::extract::{Form, Path};
use crate::page::answer::{InPage, PageError};
use crate::page::note::Note;

/// The labels of a thing in the form of a page.
pub struct Labelled {
    /// The path of the form.
    pub action: String,
    pub name: String,
    pub note: String,
    /// The note as HTML; `None` without one.
    pub shown: Option<Note>,
    /// Its own tags, if it is not a job.
    pub tags: Vec<String>,
    /// The job's tags.
    pub job_tags: Vec<TagLink>,
    /// Its own tags in one line.
    pub tag_line: String,
    /// The aliases of a checkpoint in one line; `None` of other things, which have none.
    pub aliases: Option<String>,
}

/// A tag with a link to its experiments.
pub struct TagLink {
    pub href: String,
    pub tag: String,
}

impl TagLink {
    /// The tags of a job.
    pub fn all(tags: &[String]) -> Vec<Self> {
        let href = |tag: &str| {
            let tag: String = form_urlencoded::byte_serialize(tag.as_bytes()).collect();
            format!("/?tag={tag}")
        };
        tags.iter().map(|tag| Self { href: href(tag), tag: tag.clone() }).collect()
    }
}

impl Labelled {
    pub fn of_job(job: &Job) -> Self {
        let action = format!("/jobs/{}", job.id);
        let tag_line = job.tags.join(" ");
        Self { tag_line, ..Self::new(action, &job.name, job.note.as_ref(), &[], &job.tags) }
    }

    pub fn new(
        action: String,
        name: &str,
        note: Option<&String>,
        tags: &[String],
        job_tags: &[String],
    ) -> Self {
        Self {
            action,
            name: name.to_owned(),
            shown: note.and_then(|note| Note::new(note)),
            note: note.cloned().unwrap_or_default(),
            tags: tags.to_vec(),
            job_tags: TagLink::all(job_tags),
            tag_line: tags.join(" "),
            aliases: None,
        }
    }
}

/// The fields of the form. `shown` is the name that it first showed.
#[derive(Deserialize)]
pub struct Fields {
    shown: String,
    name: String,
    note: String,
    tags: String,
    /// The aliases that it first showed, and those that it has now.
    #[serde(default)]
    shown_aliases: String,
    #[serde(default)]
    aliases: String,
}

impl Fields {
    fn change(self) -> LabelChange {
        let text = |text: String| {
            if text.is_empty() { TextChange::Remove } else { TextChange::Set(text) }
        };
        let name = self.name.trim().to_owned();
        let tags = self.tags.split([' ', ',', '\t']).filter(|tag| !tag.is_empty());
        LabelChange {
            // If the name came from the job, it is still the job's.
            name: if name == self.shown { TextChange::Nothing } else { text(name) },
            // Browsers send CRLF line ends, as in mail.
            note: text(self.note.replace("\r\n", "\n").trim_end().to_owned()),
            tags: Some(tags.map(str::to_owned).collect()),
            add_aliases: words_without(&self.aliases, &self.shown_aliases),
            remove_aliases: words_without(&self.shown_aliases, &self.aliases),
            ..LabelChange::default()
        }
    }
}

/// The words of a text that another does not have.
fn words_without(text: &str, other: &str) -> Vec<String> {
    let words = |text: &str| -> Vec<String> {
        let words = text.split([' ', ',', '\t']).filter(|word| !word.is_empty());
        words.map(str::to_owned).collect()
    };
    let others = words(other);
    words(text).into_iter().filter(|word| !others.contains(word)).collect()
}

/// The form that changes the labels of a thing of this kind, and shows the thing.
pub fn form(kind: ItemKind) -> MethodRouter<App> {
    let change = async move |State(app): State<App>,
                             InPage(Path(id)): InPage<Path<i64>>,
                             form: Result<Form<Fields>, ApiError>| {
        let Form(fields) = form?;
        app.label(kind, id, &fields.change()).await?;
        Ok::<Redirect, PageError>(Redirect::to(&format!("/{kind}s/{id}")))
    };
    post(change)
}

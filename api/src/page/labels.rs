//! Name, note and tags of a thing: shows them, and changes them by a form.

use askama::Template;
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Redirect, Response};
use axum::routing::{MethodRouter, post};
use serde::Deserialize;
use spec::Violation;
use store::Labels;
use wire::{ItemKind, Job, LabelChange, TextChange};

use crate::app::App;
use crate::app::labels::{is_alias, submitted};
use crate::error::ApiError;
use crate::extract::{Form, Path};
use crate::limits::TAGS;
use crate::page::answer::{InPage, PageError, html};
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

impl Labelled {
    /// The form that changes them.
    pub fn form(&self) -> LabelForm {
        let aliases = self.aliases.clone().unwrap_or_default();
        LabelForm {
            action: self.action.clone(),
            fields: Fields {
                shown: self.name.clone(),
                name: self.name.clone(),
                note: self.note.clone(),
                tags: self.tag_line.clone(),
                shown_aliases: aliases.clone(),
                aliases,
            },
            has_aliases: self.aliases.is_some(),
            violations: Vec::new(),
        }
    }
}

/// A form with labels, as they are or as they were typed.
pub struct LabelForm {
    pub action: String,
    pub fields: Fields,
    pub has_aliases: bool,
    pub violations: Vec<Violation>,
}

impl LabelForm {
    /// Why an input was refused.
    pub fn refusals(&self, input: &str) -> Vec<String> {
        let of_it = |violation: &&Violation| {
            let field = violation.field.split('[').next().unwrap_or_default();
            field.trim_start_matches("add_").trim_start_matches("remove_") == input
        };
        let reason =
            |it: &Violation| format!("{} is not allowed; allowed: {}", it.value, it.allowed);
        self.violations.iter().filter(of_it).map(reason).collect()
    }
}

/// The fields of the form. `shown` is the name that it first showed.
#[derive(Clone, Deserialize)]
pub struct Fields {
    pub shown: String,
    pub name: String,
    pub note: String,
    pub tags: String,
    /// The aliases that it first showed, and those that it has now.
    #[serde(default)]
    pub shown_aliases: String,
    #[serde(default)]
    pub aliases: String,
}

/// A refused form, as it was typed.
#[derive(Template)]
#[template(path = "labels.html")]
struct LabelsPage {
    title: String,
    /// The thing, such as `checkpoint 8`.
    item: String,
    refusal: String,
    form: LabelForm,
}

impl LabelsPage {
    fn new(kind: ItemKind, id: i64, fields: Fields, error: &ApiError) -> Self {
        let (problem, item) = (error.to_problem(), format!("{kind} {id}"));
        Self {
            title: format!("Name, tags and note of {item}"),
            refusal: match problem.violations.is_empty() {
                true => format!("{}.", problem.detail),
                false => "Something in the form is not allowed.".to_owned(),
            },
            form: LabelForm {
                action: format!("/{kind}s/{id}"),
                fields,
                has_aliases: kind == ItemKind::Checkpoint,
                violations: problem.violations,
            },
            item,
        }
    }
}

impl Fields {
    fn change(self) -> LabelChange {
        let text = |text: String| {
            if text.is_empty() { TextChange::Remove } else { TextChange::Set(text) }
        };
        let name = self.name.trim().to_owned();
        LabelChange {
            // If the name came from the job, it is still the job's.
            name: if name == self.shown { TextChange::Nothing } else { text(name) },
            // Browsers send CRLF line ends, as in mail.
            note: text(self.note.replace("\r\n", "\n").trim_end().to_owned()),
            tags: Some(words(&self.tags)),
            add_aliases: words_without(&self.aliases, &self.shown_aliases),
            remove_aliases: words_without(&self.shown_aliases, &self.aliases),
            ..LabelChange::default()
        }
    }
}

/// The labels of a new job, as somebody typed them.
pub(super) fn typed_labels(name: &str, tags: &str) -> Result<Labels, ApiError> {
    let name = Some(name.trim().to_owned()).filter(|name| !name.is_empty());
    submitted(name, None, words(tags))
}

fn words(text: &str) -> Vec<String> {
    text.split([' ', ',', '\t']).filter(|word| !word.is_empty()).map(str::to_owned).collect()
}

/// The words of a text that another does not have.
fn words_without(text: &str, other: &str) -> Vec<String> {
    let others = words(other);
    words(text).into_iter().filter(|word| !others.contains(word)).collect()
}

/// The form that changes the labels of a thing of this kind, and shows the thing. A refused form is
/// shown again with what is wrong in it.
pub fn form(kind: ItemKind) -> MethodRouter<App> {
    let change = async move |State(app): State<App>,
                             InPage(Path(id)): InPage<Path<i64>>,
                             form: Result<Form<Fields>, ApiError>| {
        let Form(fields) = form?;
        let change = fields.clone().change();
        let moved = moved_from(&app, id, &change.add_aliases).await?;
        match app.label(kind, id, &change).await {
            Ok(()) => Ok::<Response, PageError>(
                Redirect::to(&format!("/{kind}s/{id}{moved}")).into_response(),
            ),
            Err(error) if is_of_the_form(error.status()) => {
                let page = html(&LabelsPage::new(kind, id, fields, &error))?;
                Ok((error.status(), page).into_response())
            }
            Err(error) => Err(error.into()),
        }
    };
    post(change)
}

fn is_of_the_form(status: StatusCode) -> bool {
    [StatusCode::UNPROCESSABLE_ENTITY, StatusCode::CONFLICT].contains(&status)
}

/// The query that tells the page which aliases stood for another checkpoint, and for which.
async fn moved_from(app: &App, to: i64, aliases: &[String]) -> Result<String, ApiError> {
    let mut moved = Vec::new();
    for alias in aliases.iter().filter(|alias| is_alias(alias)).take(TAGS) {
        match app.checkpoint_of_alias(alias).await {
            Ok(from) if from != to => moved.push(format!("moved={alias}:{from}")),
            Ok(_) | Err(ApiError::NotFound { .. }) => {}
            Err(error) => return Err(error),
        }
    }
    Ok(if moved.is_empty() { String::new() } else { format!("?{}", moved.join("&")) })
}

/// Sentences about the aliases of a checkpoint that stood for another one before, from the query
/// that its form led to.
pub fn moved_aliases(pairs: &[(String, String)], aliases: &[String]) -> Vec<String> {
    let told = |(name, value): &(String, String)| {
        let (alias, from) = value.split_once(':').filter(|_| name == "moved")?;
        let from: i64 = from.parse().ok()?;
        let is_here = aliases.iter().any(|known| known == alias);
        is_here.then(|| format!("@{alias} stood for checkpoint {from} before."))
    };
    pairs.iter().filter_map(told).collect()
}

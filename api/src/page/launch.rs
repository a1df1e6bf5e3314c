//! The page that submits a spec: from a preset, from an earlier job, or written here.

use askama::Template;
use axum::body::Bytes;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Redirect, Response};
use serde::Deserialize;
use spec::{PresetPlace, Violation};

use crate::app::submission::Reuse;
use crate::app::{App, labels};
use crate::error::ApiError;
use crate::extract::{Form, Query};
use crate::limits::SPEC_FORM_BYTES;
use crate::page::answer::{InPage, PageError, html};
use crate::page::parts::Commands;
use crate::page::spec_text::spec_text;

#[derive(Template)]
#[template(path = "launch.html")]
struct LaunchPage {
    /// The job or the preset that the text comes from, in words; empty for neither.
    from: String,
    fields: Fields,
    /// Why the text was refused; empty before it was submitted.
    refusal: String,
    violations: Vec<Violation>,
    presets: Vec<Choice>,
    commands: Commands,
}

/// A preset to begin with.
struct Choice {
    name: &'static str,
    about: &'static str,
}

/// The query of the page: the job or the preset that its form begins with.
#[derive(Deserialize)]
pub struct Begin {
    job: Option<i64>,
    preset: Option<String>,
}

/// The fields of the form.
#[derive(Deserialize)]
pub struct Fields {
    spec: String,
    #[serde(default)]
    name: String,
    #[serde(default)]
    tags: String,
}

/// The form, with the spec of a job or a preset if one is asked for.
pub async fn show(
    State(app): State<App>,
    InPage(Query(begin)): InPage<Query<Begin>>,
    headers: HeaderMap,
) -> Result<Response, PageError> {
    let (from, spec) = match (begin.job, begin.preset) {
        (Some(id), _) => {
            let job = app.job(id).await?;
            (format!("The spec of job {id}, {}.", job.name), spec_text(&job.spec))
        }
        (None, Some(name)) => {
            let preset = jobs().find(|preset| preset.name == name);
            let preset = preset.ok_or_else(|| ApiError::not_found("preset", &name))?;
            (format!("The preset {name}: {}.", preset.about), spec_text(&preset.spec))
        }
        (None, None) => (String::new(), String::new()),
    };
    let fields = Fields { spec, name: String::new(), tags: String::new() };
    Ok(html(&LaunchPage::new(from, fields, &headers))?)
}

/// Submits the form and shows the job. A refused form is shown again with what is wrong in it.
pub async fn submit(
    State(app): State<App>,
    headers: HeaderMap,
    form: Result<Form<Fields, SPEC_FORM_BYTES>, ApiError>,
) -> Result<Response, PageError> {
    let Form(fields) = form?;
    let submitted = submit_fields(&app, &fields).await;
    match submitted {
        Ok(job) => Ok(Redirect::to(&format!("/jobs/{job}")).into_response()),
        Err(error) if error.status().is_client_error() => {
            let problem = error.to_problem();
            let page = LaunchPage {
                refusal: problem.title.clone(),
                violations: match problem.violations.is_empty() {
                    true => vec![Violation::new("", "", problem.detail)],
                    false => problem.violations,
                },
                ..LaunchPage::new(String::new(), fields, &headers)
            };
            Ok((error.status(), html(&page)?).into_response())
        }
        Err(error) => Err(error.into()),
    }
}

async fn submit_fields(app: &App, fields: &Fields) -> Result<i64, ApiError> {
    let name = Some(fields.name.trim().to_owned()).filter(|name| !name.is_empty());
    let tags = fields.tags.split([' ', ',', '\t']).filter(|tag| !tag.is_empty());
    let labels = labels::submitted(name, None, tags.map(str::to_owned).collect())?;
    let text = Bytes::from(fields.spec.clone());
    Ok(app.submit(text, Reuse::SameDigest, None, labels).await?.job.id)
}

impl LaunchPage {
    fn new(from: String, fields: Fields, headers: &HeaderMap) -> Self {
        Self {
            from,
            fields,
            refusal: String::new(),
            violations: Vec::new(),
            presets: jobs()
                .map(|preset| Choice { name: &preset.name, about: &preset.about })
                .collect(),
            commands: Commands::new(headers),
        }
    }
}

/// The presets of whole jobs.
fn jobs() -> impl Iterator<Item = &'static spec::Preset> {
    spec::presets().iter().filter(|preset| preset.place == PresetPlace::Job)
}

//! The page that submits a spec: field by field from a preset or an earlier job, or written as JSON.

use askama::Template;
use axum::body::Bytes;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Redirect, Response};
use reports::json::readable;
use serde::Deserialize;
use serde_json::Value;
use spec::{PresetPlace, SpecError, Violation};
use store::Labels;
use wire::{ItemKind, LabelChange, TextChange};

use crate::app::App;
use crate::app::submission::{Reuse, Submitted};
use crate::error::ApiError;
use crate::extract::{Form, Query};
use crate::limits::SPEC_FORM_BYTES;
use crate::page::answer::{InPage, PageError, html};
use crate::page::follow_up::{self, Start};
use crate::page::labels::typed_labels;
use crate::page::parts::Commands;
use crate::page::predict::{self, CheckpointChoice};
use crate::page::spec_form::{Changes, Group, groups, names_checkpoints, values_of};
use crate::page::sweep::sweep;

#[derive(Template)]
#[template(path = "launch.html")]
struct LaunchPage {
    /// The beginning of the form, in words; empty without one.
    about: String,
    /// The same in the form's own words: `job:3`, `preset:quickstart`, `dataset:3:train`; empty
    /// without one.
    from: String,
    /// The inputs of its spec; none without a beginning.
    groups: Vec<Group>,
    fields: Fields,
    /// Whether the text is unfolded.
    is_text_open: bool,
    /// Why the text was refused; empty before it was submitted.
    refusal: String,
    violations: Vec<Violation>,
    /// Checkpoints that a field may name.
    checkpoints: Vec<CheckpointChoice>,
    /// A job of each kind to begin with; none if the form has a beginning.
    starts: Vec<Start>,
    presets: Vec<Choice>,
    commands: Commands,
}

/// A preset to begin with.
struct Choice {
    name: &'static str,
    about: &'static str,
}

/// The query of the page: the job, the preset or the follow-up that its form begins with.
#[derive(Deserialize)]
pub struct Begin {
    job: Option<i64>,
    preset: Option<String>,
    from: Option<String>,
}

/// The fields of the form beside those of the spec.
#[derive(Default)]
pub struct Fields {
    /// The spec as JSON.
    spec: String,
    name: String,
    tags: String,
    /// The field that a sweep varies, and its values.
    sweep: String,
    values: String,
}

impl Fields {
    fn read(pairs: &[(String, String)]) -> Self {
        let text = |wanted: &str| {
            let found = pairs.iter().find(|(name, _)| name == wanted);
            found.map(|(_, value)| value.clone()).unwrap_or_default()
        };
        Self {
            spec: text("spec"),
            name: text("name"),
            tags: text("tags"),
            sweep: text("sweep").trim().to_owned(),
            values: text("values"),
        }
    }
}

/// The beginning of a form.
struct Beginning {
    about: String,
    from: String,
    /// Its spec as it was written.
    written: Value,
    /// The same spec with every default filled in.
    spec: Value,
}

impl Beginning {
    async fn of(app: &App, from: &str) -> Result<Self, ApiError> {
        let unknown = || {
            let allowed = "job:ID, preset:NAME, new:KIND, or a follow-up such as dataset:ID:train";
            ApiError::parameter("from", from, allowed)
        };
        let (kind, name) = from.split_once(':').ok_or_else(unknown)?;
        let (about, spec) = match kind {
            "job" => {
                let job = app.job(name.parse().map_err(|_| unknown())?).await?;
                (format!("The spec of job {name}, {}.", job.name), job.spec)
            }
            "preset" => {
                let preset = jobs().find(|preset| preset.name == name);
                let preset = preset.ok_or_else(|| ApiError::not_found("preset", name))?;
                (format!("The preset {name}: {}.", preset.about), preset.spec.clone())
            }
            _ => follow_up::beginning(app, from).await?.ok_or_else(unknown)?,
        };
        // A preset with fields that are not given yet, and a spec of another version, stay as they are.
        let complete = spec::parse_json(spec.clone()).map(|spec| spec.to_json());
        let complete = complete.unwrap_or_else(|_| spec.clone());
        Ok(Self { about, from: from.to_owned(), written: spec, spec: complete })
    }
}

/// The form, with the spec of a job or a preset if one is asked for.
pub async fn show(
    State(app): State<App>,
    InPage(Query(begin)): InPage<Query<Begin>>,
    headers: HeaderMap,
) -> Result<Response, PageError> {
    let job = begin.job.map(|id| format!("job:{id}"));
    let preset = begin.preset.map(|name| format!("preset:{name}"));
    let Some(from) = job.or(preset).or(begin.from) else {
        return Ok(html(&LaunchPage::new(&app, None, Fields::default(), &headers).await?)?);
    };
    let beginning = Beginning::of(&app, &from).await?;
    let fields = Fields { spec: readable(&beginning.written), ..Fields::default() };
    let begin = Some((&beginning, &Changes::default()));
    Ok(html(&LaunchPage::new(&app, begin, fields, &headers).await?)?)
}

/// Submits the form and shows the job. A refused form is shown again with what is wrong in it.
pub async fn submit(
    State(app): State<App>,
    headers: HeaderMap,
    form: Result<Form<Vec<(String, String)>, SPEC_FORM_BYTES>, ApiError>,
) -> Result<Response, PageError> {
    let Form(pairs) = form?;
    let given = |wanted: &str| pairs.iter().find(|(name, _)| name == wanted).map(|(_, it)| &**it);
    let changes = Changes::read(&pairs);
    let beginning = match given("from").filter(|from| !from.is_empty()) {
        Some(from) => Some(Beginning::of(&app, from).await?),
        None if given("spec").is_none() => {
            let reason =
                "missing field `spec`, or `from` with the job or preset that it begins with";
            return Err(ApiError::Form { reason: reason.to_owned() }.into());
        }
        None => None,
    };
    let mut fields = Fields::read(&pairs);
    let spec = match &beginning {
        Some(beginning) => beginning.changed(&changes, &fields).map(|spec| readable(&spec)),
        None => Ok(fields.spec.clone()),
    };
    let submitted = match spec {
        Ok(text) if given("show").is_some() => {
            // Only the text is asked for.
            fields.spec = text;
            let begin = beginning.as_ref().map(|beginning| (beginning, &changes));
            let page = LaunchPage::new(&app, begin, fields, &headers).await?;
            return Ok(html(&LaunchPage { is_text_open: true, ..page })?);
        }
        Ok(text) => {
            fields.spec = text;
            let reuse = if given("force").is_some() { Reuse::Never } else { Reuse::SameDigest };
            submit_fields(&app, &fields, reuse).await
        }
        Err(error) => Err(ApiError::Spec(error)),
    };
    match submitted {
        Ok(Submitted { job, created }) => {
            let again = if created { String::new() } else { again(&fields.name, &fields.tags) };
            Ok(Redirect::to(&format!("/jobs/{}{again}", job.id)).into_response())
        }
        Err(error) if error.status().is_client_error() => {
            let problem = error.to_problem();
            let violations = match problem.violations.is_empty() {
                true => vec![Violation::new("", "", problem.detail)],
                false => problem.violations,
            };
            let begin = beginning.as_ref().map(|beginning| (beginning, &changes));
            let page = LaunchPage::new(&app, begin, fields, &headers).await?;
            let page = page.refused(problem.title, violations, begin);
            Ok((error.status(), html(&page)?).into_response())
        }
        Err(error) => Err(error.into()),
    }
}

impl Beginning {
    /// The spec with the typed values, and as a sweep if one is asked for.
    fn changed(&self, changes: &Changes, fields: &Fields) -> Result<Value, SpecError> {
        let spec = changes.applied(&self.spec)?;
        match fields.sweep.is_empty() {
            true => Ok(spec),
            false => sweep(&spec, &fields.sweep, &values_of(&fields.values)),
        }
    }
}

/// Submits the spec. Name and tags are for a new job: one that is there keeps its own, because other
/// people know it by them.
async fn submit_fields(app: &App, fields: &Fields, reuse: Reuse) -> Result<Submitted, ApiError> {
    let labels = typed_labels(&fields.name, &fields.tags)?;
    let text = Bytes::from(fields.spec.clone());
    label_new(app, app.submit(text, reuse, None, Labels::default()).await?, labels).await
}

/// Gives a job its labels if it is new.
pub(super) async fn label_new(
    app: &App,
    submitted: Submitted,
    labels: Labels,
) -> Result<Submitted, ApiError> {
    let change = LabelChange {
        name: labels.name.map_or(TextChange::Nothing, TextChange::Set),
        add_tags: labels.tags.into_iter().collect(),
        ..LabelChange::default()
    };
    if !submitted.created || change == LabelChange::default() {
        return Ok(submitted);
    }
    app.label(ItemKind::Job, submitted.job.id, &change).await?;
    Ok(submitted)
}

/// The query of a job's page that says that the job was there before, with what was typed for it.
pub(super) fn again(name: &str, tags: &str) -> String {
    let mut query = form_urlencoded::Serializer::for_suffix("?again=1".to_owned(), 1);
    for (field, typed) in [("name", name.trim()), ("tags", tags.trim())] {
        if !typed.is_empty() {
            query.append_pair(field, typed);
        }
    }
    query.finish()
}

impl LaunchPage {
    async fn new(
        app: &App,
        begin: Option<(&Beginning, &Changes)>,
        fields: Fields,
        headers: &HeaderMap,
    ) -> Result<Self, ApiError> {
        let groups = begin.map(|(beginning, changes)| groups(&beginning.spec, changes, Vec::new()));
        let groups = groups.map(|(groups, _)| groups).unwrap_or_default();
        let checkpoints = match groups.iter().flat_map(Group::paths).any(names_checkpoints) {
            true => predict::newest_checkpoints(app).await?,
            false => Vec::new(),
        };
        let starts = match begin {
            None => follow_up::starts(app).await?,
            Some(_) => Vec::new(),
        };
        Ok(Self {
            checkpoints,
            starts,
            about: begin.map(|(beginning, _)| beginning.about.clone()).unwrap_or_default(),
            from: begin.map(|(beginning, _)| beginning.from.clone()).unwrap_or_default(),
            groups,
            fields,
            is_text_open: begin.is_none(),
            refusal: String::new(),
            violations: Vec::new(),
            presets: jobs()
                .map(|preset| Choice { name: &preset.name, about: &preset.about })
                .collect(),
            commands: Commands::new(headers),
        })
    }

    /// The page with violations, those of fields beside their inputs.
    fn refused(
        self,
        refusal: String,
        violations: Vec<Violation>,
        begin: Option<(&Beginning, &Changes)>,
    ) -> Self {
        let Some((beginning, changes)) = begin else {
            return Self { refusal, violations, ..self };
        };
        let (groups, violations) = groups(&beginning.spec, changes, violations);
        Self { refusal, violations, groups, ..self }
    }
}

/// The presets of whole jobs.
fn jobs() -> impl Iterator<Item = &'static spec::Preset> {
    spec::presets().iter().filter(|preset| preset.place == PresetPlace::Job)
}

//! The page that takes files: recordings, which become a dataset, and the URDF of an arm.

use askama::Template;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Redirect, Response};
use serde_json::{Value, json};
use spec::{SpecError, Violation};
use store::Labels;
use wire::{Listed as _, Robot};

use crate::app::App;
use crate::app::listing::ListRequest;
use crate::app::robots::SentRobot;
use crate::app::submission::Reuse;
use crate::error::ApiError;
use crate::extract::RobotText;
use crate::page::answer::{PageError, html};
use crate::page::labels::typed_labels;
use crate::page::launch::{again, label_new};
use crate::page::parts::Commands;
use crate::upload::IncomingForm;

#[derive(Template)]
#[template(path = "upload.html")]
struct UploadPage {
    /// The robots that recordings may be of, the newest first.
    robots: Vec<Choice>,
    texts: Texts,
    /// The form that was refused; empty before one was sent.
    refused: &'static str,
    refusal: String,
    violations: Vec<Violation>,
    commands: Commands,
}

/// A robot to choose.
struct Choice {
    id: String,
    name: String,
}

/// The typed texts of a form, by the inputs' names.
struct Texts(Vec<(String, String)>);

impl Texts {
    /// The text of an input; empty if it has none.
    fn of(&self, name: &str) -> &str {
        let found = self.0.iter().find(|(known, _)| known == name);
        found.map_or("", |(_, text)| text.trim())
    }
}

/// A mapping to begin with: windows of the columns that torqued's own logs have.
fn example() -> Value {
    let columns = |letter: char| (1..=7).map(|k| format!("{letter}{k}")).collect::<Vec<_>>();
    json!({
        "columns": {"time": "t", "u": columns('u'), "q": columns('q')},
        "rate_hz": 60,
        "resampling": "linear",
        "samples": 400,
        "split": {"kind": "windows", "stride": 200},
    })
}

/// Robots in the form.
const CHOICES: usize = 50;

impl UploadPage {
    async fn new(app: &App, texts: Texts, headers: &HeaderMap) -> Result<Self, ApiError> {
        let newest = [("limit".to_owned(), CHOICES.to_string())];
        let found = app.list::<Robot>(&ListRequest::read(&Robot::LIST, &newest)?).await?;
        let choice = |robot: Robot| Choice { id: robot.id.to_string(), name: robot.name };
        Ok(Self {
            robots: found.robots.into_iter().map(choice).collect(),
            texts,
            refused: "",
            refusal: String::new(),
            violations: Vec::new(),
            commands: Commands::new(headers),
        })
    }

    /// The page with a form that was refused, or the error if it is not the sender's.
    async fn refuse(
        app: &App,
        headers: &HeaderMap,
        texts: Texts,
        refused: &'static str,
        error: ApiError,
    ) -> Result<Response, PageError> {
        if !error.status().is_client_error() {
            return Err(error.into());
        }
        let problem = error.to_problem();
        let violations = match problem.violations.is_empty() {
            true => vec![Violation::new("", "", problem.detail)],
            false => problem.violations,
        };
        let page = Self::new(app, texts, headers).await?;
        let page = Self { refused, refusal: problem.title, violations, ..page };
        Ok((error.status(), html(&page)?).into_response())
    }

    /// The choices for the weight in the torques: the value of `robot.gravity`, and its words.
    const fn weights(&self) -> [(&'static str, &'static str); 3] {
        [
            ("off", "not contained"),
            ("on", "contained"),
            ("compensated", "contained, because the controller adds it"),
        ]
    }

    /// The mapping in the form.
    fn mapping(&self) -> String {
        match self.texts.of("spec") {
            "" => reports::json::readable(&example()),
            typed => typed.to_owned(),
        }
    }
}

/// Both forms.
pub async fn show(State(app): State<App>, headers: HeaderMap) -> Result<Response, PageError> {
    Ok(html(&UploadPage::new(&app, Texts(Vec::new()), &headers).await?)?)
}

/// Imports recordings, and shows the job.
pub async fn recordings(
    State(app): State<App>,
    headers: HeaderMap,
    form: Result<IncomingForm, ApiError>,
) -> Result<Response, PageError> {
    let IncomingForm { texts, mut files } = form?;
    let texts = Texts(texts);
    let imported = async {
        let labels = typed_labels(texts.of("name"), texts.of("tags"))?;
        let mapping = of_robot(texts.of("spec"), texts.of("robot"), texts.of("gravity"))?;
        files.spec = mapping.to_string().into();
        let imported = app.import(files, Reuse::SameDigest, None, Labels::default()).await?;
        label_new(&app, imported, labels).await
    };
    match imported.await {
        Ok(submitted) => {
            let again = match submitted.created {
                true => String::new(),
                false => again(texts.of("name"), texts.of("tags")),
            };
            Ok(Redirect::to(&format!("/jobs/{}{again}", submitted.job.id)).into_response())
        }
        Err(error) => UploadPage::refuse(&app, &headers, texts, "recordings", error).await,
    }
}

/// Keeps the arm of a URDF or of a description, and shows it.
pub async fn robot(
    State(app): State<App>,
    headers: HeaderMap,
    form: Result<IncomingForm, ApiError>,
) -> Result<Response, PageError> {
    let IncomingForm { texts, mut files } = form?;
    let texts = Texts(texts);
    let added = async {
        let bytes = files.read(urdf::MAX_BYTES).await?;
        let text = match files.name.to_ascii_lowercase().ends_with(".json") {
            true => RobotText::Description(bytes),
            false => RobotText::Urdf(bytes),
        };
        let (sent, name) = SentRobot::from(text).with(options(&texts))?;
        app.add_robot(sent, name).await
    };
    match added.await {
        Ok((robot, _)) => Ok(Redirect::to(&format!("/robots/{}", robot.id)).into_response()),
        Err(error) => UploadPage::refuse(&app, &headers, texts, "robot", error).await,
    }
}

/// The options of reading a URDF that were typed, as in a query.
fn options(texts: &Texts) -> Vec<(String, String)> {
    let given = ["name", "base", "tip", "mount", "nearest_physical"].into_iter();
    let given = given.map(|name| (name, texts.of(name))).filter(|(_, text)| !text.is_empty());
    let locks = texts.of("lock").split_whitespace().map(|lock| ("lock", lock));
    given.chain(locks).map(|(name, text)| (name.to_owned(), text.to_owned())).collect()
}

/// The mapping, as one of recordings of the chosen robot, whose torques contain its weight or not.
/// A robot and a gravity that the mapping has itself are kept.
fn of_robot(mapping: &str, robot: &str, gravity: &str) -> Result<Value, ApiError> {
    let mut mapping: Value = serde_json::from_str(mapping).map_err(|error| {
        ApiError::from(SpecError::one("", error.to_string(), "a mapping, a JSON object"))
    })?;
    if let Some(fields) = mapping.as_object_mut()
        && let Ok(id) = robot.parse::<i64>()
    {
        fields.entry("robot").or_insert_with(|| json!({"model": {"robot": id}}));
    }
    if let Some(fields) = mapping.as_object_mut()
        && !gravity.is_empty()
        && let Some(robot) = fields.entry("robot").or_insert_with(|| json!({})).as_object_mut()
    {
        robot.entry("gravity").or_insert_with(|| json!(gravity));
    }
    Ok(mapping)
}

//! Robots that the server keeps: from URDFs and descriptions to their links and files.

use std::collections::BTreeSet;

use axum::body::Bytes;
use figures::Size;
use serde_json::Value;
use spec::{Digest, RobotDescription, SpecError, shape_violations};
use store::{Listing, NewRobot, RobotId, RobotSource, Store, StoreError};
use urdf::{Arm, Options};
use wire::{RemovedRobot, Robot, RobotUrdf};

use crate::access::caller_name;
use crate::app::App;
use crate::app::files::Download;
use crate::app::labels::is_line;
use crate::app::resources::Resource;
use crate::error::ApiError;
use crate::extract::RobotText;
use crate::limits::NAME_CHARACTERS;

/// In pixels.
const FIGURE_SIZE: Size = Size { width: 860, height: 480 };

/// A robot as it was sent.
#[derive(Debug)]
pub enum SentRobot {
    /// A URDF, and how to read it.
    Urdf(Bytes, Options),
    /// A description as JSON.
    Description(Bytes),
}

impl From<RobotText> for SentRobot {
    fn from(text: RobotText) -> Self {
        match text {
            RobotText::Urdf(text) => Self::Urdf(text, Options::default()),
            RobotText::Description(text) => Self::Description(text),
        }
    }
}

impl SentRobot {
    /// The robot with the parameters of its request, and the name that they give it.
    ///
    /// # Errors
    /// [`ApiError::Parameter`] for a value that is not allowed, or not for this robot.
    pub fn with(
        mut self,
        parameters: Vec<(String, String)>,
    ) -> Result<(Self, Option<String>), ApiError> {
        let mut name = None;
        let mut seen = BTreeSet::new();
        for (parameter, value) in parameters {
            if parameter != "lock" && !seen.insert(parameter.clone()) {
                return Err(ApiError::parameter(&parameter, value, "given once"));
            }
            if parameter == "name" {
                name = Some(value);
                continue;
            }
            let Self::Urdf(_, options) = &mut self else {
                let allowed = "left out: it is only for a URDF; send the arm's URDF or edit the \
                               description instead";
                return Err(ApiError::parameter(&parameter, value, allowed));
            };
            let refused = |allowed: &str| ApiError::parameter(&parameter, &value, allowed);
            match parameter.as_str() {
                "base" => options.base = Some(value),
                "tip" => options.tip = Some(value),
                "lock" => {
                    let (joint, position) = urdf::read_lock(&value).map_err(refused)?;
                    if options.locks.insert(joint, position).is_some() {
                        return Err(refused("each joint once"));
                    }
                }
                "mount" => options.mount = urdf::read_mount(&value).map_err(refused)?,
                "nearest_physical" => {
                    let word = value.parse();
                    options.nearest_physical = word.map_err(|_| refused("true, false"))?;
                }
                _ => {}
            }
        }
        Ok((self, name))
    }
}

/// A robot that was read.
struct ReadRobot {
    description: RobotDescription,
    source: Option<RobotSource>,
    doubts: Vec<String>,
}

/// A robot of the store in full.
struct KnownRobot {
    row: store::Robot,
    /// `None` if another version wrote it in another form.
    description: Option<RobotDescription>,
    /// The arm of its URDF; `None` if it came as a description.
    arm: Option<Arm>,
}

impl Resource for Robot {
    type Row = store::Robot;

    async fn rows(
        store: &Store,
        listing: &Listing,
    ) -> Result<store::Listed<Self::Row>, StoreError> {
        store.list_robots(listing).await
    }

    /// Lists leave descriptions out.
    fn spec(_: &Self::Row) -> Option<&Value> {
        None
    }

    async fn complete(_: &App, rows: Vec<Self::Row>) -> Result<Vec<Self>, ApiError> {
        let listed = |row: store::Robot| {
            let description = described(&row);
            in_list(row, description.as_ref())
        };
        Ok(rows.into_iter().map(listed).collect())
    }

    async fn find(app: &App, id: i64) -> Result<Self, ApiError> {
        app.kept_robot(id).await
    }
}

impl App {
    /// Keeps a robot. Returns it, and whether it is new.
    ///
    /// # Errors
    /// [`ApiError::Urdf`], [`ApiError::Json`] or [`ApiError::Spec`] when it is refused.
    pub(crate) async fn add_robot(
        &self,
        sent: SentRobot,
        name: Option<String>,
    ) -> Result<(Robot, bool), ApiError> {
        let named = name.as_deref().is_none_or(|name| is_line(name, NAME_CHARACTERS));
        if !named {
            let allowed = format!("1 to {NAME_CHARACTERS} characters in one line");
            return Err(ApiError::parameter("name", name.unwrap_or_default(), allowed));
        }
        let bytes = match &sent {
            SentRobot::Urdf(text, _) | SentRobot::Description(text) => text.len(),
        };
        let ReadRobot { description, source, doubts } =
            self.checks.run(bytes, move || sent.read()).await?;
        let new = NewRobot {
            name: name.unwrap_or_else(|| in_one_line(&description.name)),
            description,
            source,
            doubts,
            job: None,
            added_by: Some(caller_name()),
        };
        let added = self.store.add_robot(&new).await?;
        Ok((self.kept_robot(added.id.0).await?, added.created))
    }

    /// The id of the robot whose description has this digest.
    pub(crate) async fn robot_with(&self, digest: Digest) -> Result<Option<i64>, ApiError> {
        Ok(self.store.robot_by_digest(digest).await?.map(|robot| robot.id.0))
    }

    pub(crate) async fn kept_robot(&self, id: i64) -> Result<Robot, ApiError> {
        let KnownRobot { row, description, arm } = self.known_robot(id).await?;
        let json = row.description.clone();
        let mut robot = in_list(row, description.as_ref());
        robot.links = description
            .map(|description| urdf::links(&description, arm.as_ref()))
            .unwrap_or_default();
        robot.description = Some(json);
        Ok(robot)
    }

    /// A file of a robot, which is made on request.
    ///
    /// # Errors
    /// [`ApiError::NotFound`] when it has no such file.
    pub(crate) async fn robot_file(&self, id: i64, name: &str) -> Result<Download, ApiError> {
        let known = self.known_robot(id).await?;
        let (media_type, bytes) = match (name, &known.description) {
            ("description.json", _) => {
                // Numbers and texts can always be written.
                let json = serde_json::to_vec_pretty(&known.row.description).unwrap_or_default();
                ("application/json", json)
            }
            ("arm.urdf", _) => match self.store.robot_source(RobotId(id)).await? {
                Some(source) => ("application/xml", source.urdf.into_bytes()),
                None => {
                    let file = format!("arm.urdf of robot {id}, which came as a description");
                    return Err(ApiError::not_found("file", file));
                }
            },
            ("arm.xml", Some(description)) => {
                let model = urdf::mjcf(description, known.arm.as_ref())?;
                ("application/xml", model.into_bytes())
            }
            ("zero-pose.svg", Some(description)) => {
                let figure = urdf::zero_pose(description, known.arm.as_ref());
                ("image/svg+xml", figure.to_svg(FIGURE_SIZE)?.into_bytes())
            }
            ("arm.xml" | "zero-pose.svg", None) => {
                let file =
                    format!("{name} of robot {id}, which another version of torqued described");
                return Err(ApiError::not_found("file", file));
            }
            _ => {
                let files = "description.json, arm.urdf, arm.xml and zero-pose.svg";
                let file = format!("{name:?} of robot {id}; there are {files}");
                return Err(ApiError::not_found("file", file));
            }
        };
        Ok(Download::made(format!("robot-{id}-{name}"), media_type, bytes))
    }

    /// Forgets a robot.
    pub(crate) async fn remove_robot(&self, id: i64) -> Result<RemovedRobot, ApiError> {
        let digest = self.store.robot(RobotId(id)).await?.digest;
        self.store.remove_robot(RobotId(id)).await?;
        Ok(RemovedRobot { id, digest })
    }

    async fn known_robot(&self, id: i64) -> Result<KnownRobot, ApiError> {
        let row = self.store.robot(RobotId(id)).await?;
        let source = self.store.robot_source(row.id).await?;
        let bytes = source.as_ref().map_or(0, |source| source.urdf.len());
        let read = move || {
            let description = described(&row);
            let arm = source.and_then(|source| arm(&source, description.as_ref()));
            Ok(KnownRobot { row, description, arm })
        };
        self.checks.run(bytes, read).await
    }
}

impl SentRobot {
    fn read(self) -> Result<ReadRobot, ApiError> {
        match self {
            Self::Urdf(text, options) => read_urdf(&text, options),
            Self::Description(text) => {
                let description = read_description(&text)?;
                Ok(ReadRobot { description, source: None, doubts: Vec::new() })
            }
        }
    }
}

fn read_urdf(text: &[u8], options: Options) -> Result<ReadRobot, ApiError> {
    let text = std::str::from_utf8(text).map_err(|error| ApiError::Body {
        reason: format!("it is not UTF-8 from byte {} on", error.valid_up_to()),
    })?;
    let Arm { description, doubts, base, tip, .. } = urdf::read(text, &options)?;
    // The arm that is read again later is the same, whatever a later version takes for the default.
    let options = Options { base: Some(base), tip: Some(tip), ..options };
    // Numbers and texts can always be written.
    let options = serde_json::to_value(&options).unwrap_or_default();
    let source = Some(RobotSource { urdf: text.to_owned(), options });
    let doubts = doubts.iter().map(ToString::to_string).collect();
    Ok(ReadRobot { description, source, doubts })
}

/// Reads a description as it stands in a spec, with all its violations.
fn read_description(text: &[u8]) -> Result<RobotDescription, ApiError> {
    let value: Value = spec::read_json(text).map_err(ApiError::Json)?;
    shape_violations::<RobotDescription>(&value).into_result()?;
    let description: RobotDescription =
        serde_json::from_value(value).map_err(|error| SpecError::one("", "", error.to_string()))?;
    description.checked()?;
    Ok(description)
}

fn described(row: &store::Robot) -> Option<RobotDescription> {
    serde_json::from_value(row.description.clone()).ok()
}

/// The arm of a URDF that was accepted before; `None` if this version reads another one.
fn arm(source: &RobotSource, description: Option<&RobotDescription>) -> Option<Arm> {
    let options: Options = serde_json::from_value(source.options.clone()).ok()?;
    let arm = urdf::read(&source.urdf, &options).ok()?;
    let is_same = |description: &&RobotDescription| urdf::mjcf(description, Some(&arm)).is_ok();
    description.filter(is_same)?;
    Some(arm)
}

/// A robot as lists show it.
fn in_list(row: store::Robot, description: Option<&RobotDescription>) -> Robot {
    let urdf: Option<RobotUrdf> =
        row.options.map(|options| serde_json::from_value(options).unwrap_or_default());
    let mass_kg = |description: &RobotDescription| -> f64 {
        let hand = description.hand.bodies.iter().map(|attached| attached.body.mass_kg);
        description.joints.iter().map(|joint| joint.link.mass_kg).chain(hand).sum()
    };
    Robot {
        id: row.id.0,
        name: row.name,
        digest: row.digest,
        joints: description.map_or(0, |description| description.joints.len()),
        mass_kg: description.map_or(0.0, mass_kg),
        urdf,
        doubts: row.doubts,
        job: row.job.map(|job| job.0),
        added_by: row.added_by,
        created_at: row.created_at.to_string(),
        links: Vec::new(),
        description: None,
    }
}

/// A name of a file's own without line ends.
fn in_one_line(name: &str) -> String {
    let is_end = |c: char| c.is_control() || matches!(c, '\u{2028}' | '\u{2029}');
    let line: String = name.chars().map(|c| if is_end(c) { ' ' } else { c }).collect();
    if line.trim().is_empty() { "robot".to_owned() } else { line }
}

//! Robots that a server keeps.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use spec::{BaseDescription, Digest, RobotDescription};
use utoipa::ToSchema;

use crate::{List, ListCell, ListColumn, Listed, Robots, Sort, Tabled};

/// A robot that specs can name: `"robot": {"model": {"robot": ID}}`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Robot {
    /// The id that specs, paths and commands refer to it by.
    pub id: i64,
    /// The name that it was added with.
    pub name: String,
    /// The digest of its description's canonical JSON. A spec can name it by this too.
    pub digest: Digest,
    /// Number of joints.
    pub joints: usize,
    /// Mass of all bodies that move, kg.
    pub mass_kg: f64,
    /// The URDF that it was read from. `null` if it came as a description.
    pub urdf: Option<RobotUrdf>,
    /// What its user should know, as sentences.
    pub doubts: Vec<String>,
    /// The job that identified it.
    pub job: Option<i64>,
    /// The name of the token with which it was added, or `anyone`. `null` if a job added it.
    pub added_by: Option<String>,
    /// When it was added.
    pub created_at: String,
    /// The bodies that the joints move, as they are simulated. Empty in a list of robots.
    #[serde(default)]
    pub links: Vec<RobotLink>,
    /// The description, for a spec of a server that does not have the robot. Left out in a list.
    #[schema(value_type = Option<RobotDescription>)]
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub description: Option<Value>,
}

/// How a URDF was read.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default)]
pub struct RobotUrdf {
    /// The link that stands.
    pub base: String,
    /// The link with the hand's frame.
    pub tip: String,
    /// Positions of the joints that were locked, rad or m.
    pub locks: BTreeMap<String, f64>,
    /// Whether impossible inertias were replaced by the nearest that a body can have.
    pub nearest_physical: bool,
    /// Pose of the base link in the world.
    pub mount: BaseDescription,
}

/// A body that a joint moves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RobotLink {
    /// Name of the joint.
    pub joint: String,
    /// kg.
    pub mass_kg: f64,
    /// Centre of mass in the joint's frame, m.
    pub center_m: [f64; 3],
    /// Principal moments of inertia about the centre of mass, kg·m².
    pub principal_kg_m2: [f64; 3],
    /// Names of the bodies that it was put together from, as far as they are known.
    pub parts: Vec<String>,
}

/// A robot that was deleted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RemovedRobot {
    /// Its id, which is not given to another robot.
    pub id: i64,
    /// The digest of its description.
    pub digest: Digest,
}

impl Tabled for Robot {
    const COLUMNS: &'static [ListColumn<Self>] = &[
        ListColumn::number("joints", |robot| ListCell::Count(robot.joints as u64)),
        ListColumn::number("mass, kg", |robot| ListCell::Text(format!("{:.3}", robot.mass_kg))),
        ListColumn::words("from", |robot| {
            ListCell::text(match (&robot.urdf, robot.job) {
                (_, Some(job)) => format!("job {job}"),
                (Some(urdf), None) => format!("URDF, {} to {}", urdf.base, urdf.tip),
                (None, None) => "description".to_owned(),
            })
        }),
        ListColumn::number("doubts", |robot| match robot.doubts.len() {
            0 => ListCell::Missing,
            doubts => ListCell::Count(doubts as u64),
        }),
        ListColumn::words("digest", |robot| ListCell::text(robot.digest.short())),
        ListColumn::number("created", |robot| ListCell::moment(&robot.created_at)),
    ];
}

impl Listed for Robot {
    const LIST: List = List {
        name: "robots",
        empty: "`torqued robot add arm.urdf` adds a robot, and so does POST /v1/robots.",
        kinds: &[],
        only: None,
        states: &[],
        sorts: &[Sort::Created, Sort::Name],
        has_labels: false,
        has_columns: false,
    };

    type Page = Robots;

    fn id(&self) -> i64 {
        self.id
    }

    fn name(&self) -> &str {
        &self.name
    }

    fn tags(&self) -> Vec<&str> {
        Vec::new()
    }
}

//! The page of a robot: a drawing, its joints, links and doubts, how a spec names it, and its files.

use askama::Template;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Redirect, Response};
use reports::Table;
use spec::RobotDescription;
use wire::{Robot, RobotUrdf};

use crate::app::App;
use crate::extract::Path;
use crate::page::answer::{InPage, PageError, html};
use crate::page::follow_up;
use crate::page::instant::Instant;
use crate::page::lists::Paged;
use crate::page::parts::{Commands, Fact, Link};
use crate::page::text;

#[derive(Template)]
#[template(path = "robot.html")]
struct RobotPage {
    id: i64,
    name: String,
    added: Instant,
    /// Who added it; empty if nobody is known, or a job did.
    added_by: String,
    job: Option<i64>,
    digest: String,
    short_digest: String,
    facts: Vec<Fact>,
    /// Jobs that go on from it.
    follow_ups: Vec<Link>,
    doubts: Vec<String>,
    /// Whether this version can draw and compute it.
    known: bool,
    from_urdf: bool,
    /// How its URDF was read, as lines.
    reading: Vec<String>,
    tables: Vec<Table>,
    spec: String,
    commands: String,
}

impl Paged for Robot {
    fn href(&self) -> String {
        format!("/robots/{}", self.id)
    }
}

pub async fn show(
    State(app): State<App>,
    InPage(Path(id)): InPage<Path<i64>>,
    headers: HeaderMap,
) -> Result<Response, PageError> {
    let robot = app.kept_robot(id).await?;
    let description = robot
        .description
        .clone()
        .and_then(|description| serde_json::from_value::<RobotDescription>(description).ok());
    let commands = Commands::new(&headers);
    let page = RobotPage {
        id,
        added: Instant::new(&robot.created_at),
        added_by: robot.added_by.clone().filter(|_| robot.job.is_none()).unwrap_or_default(),
        job: robot.job,
        digest: robot.digest.to_string(),
        short_digest: robot.digest.short(),
        facts: facts(&robot),
        follow_ups: follow_up::of_robot(id),
        known: description.is_some(),
        from_urdf: robot.urdf.is_some(),
        reading: robot.urdf.as_ref().map(reading).unwrap_or_default(),
        tables: description
            .map(|description| {
                let joints = reports::robot::joints(&description);
                vec![joints, reports::robot::links(&robot.links)]
            })
            .unwrap_or_default(),
        spec: format!("\"robot\": {{\"model\": {{\"robot\": {id}}}}}"),
        commands: example(&commands, id),
        doubts: robot.doubts,
        name: robot.name,
    };
    Ok(html(&page)?)
}

/// Deletes a robot, and leads to the list.
pub async fn delete(
    State(app): State<App>,
    InPage(Path(id)): InPage<Path<i64>>,
) -> Result<Response, PageError> {
    app.remove_robot(id).await?;
    Ok(Redirect::to("/robots").into_response())
}

fn facts(robot: &Robot) -> Vec<Fact> {
    let moving = format!("{} kg", text::value(robot.mass_kg));
    let doubts = text::count(robot.doubts.len() as u64);
    vec![
        Fact::new("Joints", text::count(robot.joints as u64), ""),
        Fact::new("Mass", moving, "of everything that moves"),
        Fact::new("Doubts", doubts, "of reading"),
    ]
}

fn reading(urdf: &RobotUrdf) -> Vec<String> {
    let mut lines = vec![format!("From link {} to link {}", urdf.base, urdf.tip)];
    lines.extend(urdf.locks.iter().map(|(joint, at)| format!("Joint {joint} locked at {at}")));
    if !urdf.mount.is_upright() {
        let [x, y, z] = urdf.mount.position_m.map(text::value);
        let [roll, pitch, yaw] = urdf.mount.rpy_deg.map(text::value);
        lines.push(format!(
            "Mounted at {x} {y} {z} m, turned by roll {roll}°, pitch {pitch}°, yaw {yaw}°"
        ));
    }
    if urdf.nearest_physical {
        lines.push("Impossible inertias replaced by the nearest possible".to_owned());
    }
    lines
}

/// Commands that simulate it.
fn example(commands: &Commands, id: i64) -> String {
    let Commands { curl, origin } = commands;
    format!(
        "echo '{{\"kind\": \"simulate\", \"trajectories\": 1000,\n  \
         \"excitation\": {{\"fourier\": {{\"frequency_hz\": {{\"fixed\": 0.15}}}}}},\n  \
         \"controller\": {{\"law\": {{\"computed-torque\": {{}}}}}},\n  \
         \"robot\": {{\"model\": {{\"robot\": {id}}}}}}}' |\n{curl} --json @- {origin}/v1/jobs"
    )
}

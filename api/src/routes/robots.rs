//! Robots: adding and deleting them, and their files.

use axum::Json;
use axum::extract::State;
use axum::http::header::LOCATION;
use axum::http::{HeaderMap, Method, StatusCode};
use axum::response::{IntoResponse, Response};
use spec::RobotDescription;
use utoipa::IntoParams;
use wire::{RemovedRobot, Robot};

use crate::app::App;
use crate::app::robots::SentRobot;
use crate::error::ApiError;
use crate::extract::{Path, QueryPairs, RobotText};
use crate::routes::files::{RobotFile, send};

#[derive(IntoParams)]
#[into_params(parameter_in = Query)]
#[expect(dead_code, reason = "`read` reads them; here they are documented")]
pub struct RobotParameters {
    /// A name in one line, for lists. Default: the robot's own.
    #[param(min_length = 1, max_length = 200)]
    name: Option<String>,
    /// The link of a URDF that stands. Default: its root.
    base: Option<String>,
    /// The link of a URDF with the hand's frame. Default: the end of the chain with the most moving
    /// joints.
    tip: Option<String>,
    /// `JOINT=VALUE` for a URDF: a joint that shall not move, and its position in rad or m. It may be
    /// given several times.
    lock: Option<Vec<String>>,
    /// `X,Y,Z,ROLL,PITCH,YAW` for a URDF: the pose of its base in the world in m and degrees. Default:
    /// upright at the origin.
    mount: Option<String>,
    /// For a URDF, whether to take the nearest inertia that a body can have where the URDF's is
    /// impossible.
    nearest_physical: Option<bool>,
}

/// Add a robot from a URDF or a description.
///
/// Specs name it by its id, as `"robot": {"model": {"robot": ID}}`, or by its digest. If a robot with
/// the same description exists, the answer is 200 with that robot. Jobs get a copy of the
/// description, so a digest of a job covers the numbers and not the id.
#[utoipa::path(
    post,
    path = "/v1/robots",
    tag = "robots",
    security((), ("token" = ["submit"])),
    params(RobotParameters),
    request_body(content(
        (String = "application/xml"),
        (String = "text/xml"),
        (RobotDescription = "application/json"),
    )),
    responses(
        (status = 201, body = Robot, headers(("Location" = String))),
        (status = 200, body = Robot, description = "The robot exists already"),
    ),
)]
pub async fn create(
    State(app): State<App>,
    pairs: QueryPairs,
    text: RobotText,
) -> Result<Response, ApiError> {
    let (sent, name) = SentRobot::from(text).with(pairs.0)?;
    let (robot, is_new) = app.add_robot(sent, name).await?;
    let location = format!("/v1/robots/{}", robot.id);
    let status = if is_new { StatusCode::CREATED } else { StatusCode::OK };
    Ok((status, [(LOCATION, location)], Json(robot)).into_response())
}

/// Download a file of a robot: `description.json`, the URDF that it was read from as `arm.urdf`, a
/// model for MuJoCo as `arm.xml`, or a drawing with all joints at 0 as `zero-pose.svg`.
///
/// A robot that came as a description has no `arm.urdf`.
#[utoipa::path(
    get,
    path = "/v1/robots/{id}/{name}",
    tag = "robots",
    params(("id" = i64, Path), ("name" = String, Path)),
    responses(RobotFile),
)]
pub async fn file(
    State(app): State<App>,
    Path((id, name)): Path<(i64, String)>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    send(&app, &method, &headers, app.robot_file(id, &name).await?).await
}

/// Delete a robot at once.
///
/// Jobs keep their own copies of its description. It does not go to the trash: add it again to have it
/// back, under a new id and with the same digest.
#[utoipa::path(
    delete,
    path = "/v1/robots/{id}",
    tag = "robots",
    security((), ("token" = ["submit"])),
    params(("id" = i64, Path)),
    responses((status = 200, body = RemovedRobot)),
)]
pub async fn remove(
    State(app): State<App>,
    Path(id): Path<i64>,
) -> Result<Json<RemovedRobot>, ApiError> {
    Ok(Json(app.remove_robot(id).await?))
}

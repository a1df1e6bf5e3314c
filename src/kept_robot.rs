//! The robot that a command is about, which a server may keep.

use anyhow::{Context, anyhow, bail, ensure};
use clap::Args;
use reqwest::StatusCode;
use spec::{Digest, RobotModel};
use urdf::Options;
use wire::{RobotUrdf, Robots};

use crate::arguments::OptionalServerArguments;
use crate::client::{Client, ClientError};
use crate::robots::{Robot, RobotArguments, Urdf, described};

/// Flags for a robot of a file, of the program or of a server.
#[derive(Debug, Args)]
#[command(
    mut_arg("arm", |arm| arm.help(
        "A URDF, a description as JSON, the name of a built-in robot, or with --server the id, the digest or the name of \
         a robot that the server keeps; `-` reads standard input"
    )),
    mut_arg("server", |server| server.help(
        "The server that keeps the robot, unless ARM is a file or a built-in robot: HOST:PORT, http://, https:// or unix:PATH"
    ))
)]
pub struct AnyRobotArguments {
    #[command(flatten)]
    robot: RobotArguments,

    #[command(flatten)]
    server: OptionalServerArguments,
}

impl AnyRobotArguments {
    /// Reads the robot. A file comes first, then a built-in robot, then one of the server.
    ///
    /// # Errors
    /// As for [`RobotArguments::read`], and when the server does not answer or keeps no such robot.
    pub async fn read(&self) -> anyhow::Result<Robot> {
        let Some(name) = self.robot.name_on_server() else { return self.robot.read() };
        let Some(client) = self.server.client()? else {
            let missing = self.robot.read().err().map(|error| error.to_string());
            bail!("{}; --server URL names a server that keeps it", missing.unwrap_or_default());
        };
        let instead = "send the arm's URDF or an edited description with `torqued robot add`";
        self.robot.no_urdf("a robot of the server", instead)?;
        let not_here = || format!("{name} is neither a file nor a built-in robot");
        kept(&client, &name).await.with_context(not_here)
    }

    /// Whether the robot is on standard input.
    pub fn is_standard_input(&self) -> bool {
        self.robot.is_standard_input()
    }
}

/// The robot that the server keeps under an id, a digest or a name.
async fn kept(client: &Client, name: &str) -> anyhow::Result<Robot> {
    let id = match name.parse::<i64>() {
        Ok(id) => id,
        Err(_) => id_of(client, name).await?,
    };
    let wire::Robot { description, urdf: reading, mut doubts, .. } =
        client.robot(id).await.map_err(or_listed)?;
    let description = description.with_context(|| {
        format!("the server sent robot {id} without its description; its version may be another")
    })?;
    let description = described(&description.to_string())
        .with_context(|| format!("robot {id} of the server, whose version may be another"))?;
    let mut urdf = None;
    if let Some(reading) = reading {
        let text = client.download(&format!("/v1/robots/{id}/arm.urdf")).await?;
        let again = String::from_utf8(text).ok().and_then(|text| read_again(text, reading));
        // This version of the program may read another arm in the URDF.
        urdf = again.filter(|urdf| urdf::mjcf(&description, Some(&urdf.arm)).is_ok());
        if urdf.is_none() {
            doubts.push(format!(
                "the URDF of robot {id} is left out: this version of torqued does not read the description of the \
                 server in it"
            ));
        }
    }
    Ok(Robot { model: RobotModel::Described(Box::new(description)), urdf, doubts })
}

/// The error with the command that lists the robots, if there is no such robot.
fn or_listed(error: ClientError) -> anyhow::Error {
    match error {
        ClientError::Refused { status: StatusCode::NOT_FOUND, message, .. } => {
            anyhow!("{message}; `torqued robot list` lists those that it keeps")
        }
        error => error.into(),
    }
}

/// The arm of a URDF that the server has accepted.
fn read_again(text: String, reading: RobotUrdf) -> Option<Urdf> {
    let RobotUrdf { base, tip, locks, nearest_physical, mount } = reading;
    let options = Options { base: Some(base), tip: Some(tip), locks, nearest_physical, mount };
    let arm = urdf::read(&text, &options).ok()?;
    Some(Urdf { text, arm })
}

/// The id of the robot with this digest or name.
async fn id_of(client: &Client, name: &str) -> anyhow::Result<i64> {
    let digest = name.parse::<Digest>().ok();
    let mut ids = Vec::new();
    let mut cursor = None;
    loop {
        let Robots { robots, next, .. } = client.robots(cursor.as_deref()).await?;
        let is_it =
            |robot: &wire::Robot| robot.name == name || digest.is_some_and(|it| it == robot.digest);
        ids.extend(robots.iter().filter(|robot| is_it(robot)).map(|robot| robot.id));
        cursor = next;
        if cursor.is_none() {
            break;
        }
    }
    ensure!(
        !ids.is_empty(),
        "the server keeps no robot with the name or the digest {name:?}; `torqued robot list` lists those that it keeps"
    );
    let [id] = ids[..] else {
        let ids: Vec<String> = ids.iter().map(i64::to_string).collect();
        bail!("the robots {} of the server are called {name:?}, allowed: an id", ids.join(", "))
    };
    Ok(id)
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        robot: AnyRobotArguments,
    }

    #[tokio::test]
    async fn a_robot_of_the_server_has_no_options_of_a_urdf() {
        // The server is not asked.
        let line = ["command", "crane", "--server", "127.0.0.1:1", "--tip", "a"];
        let refused = Command::parse_from(line).robot.read().await.unwrap_err();
        assert_eq!(
            refused.to_string(),
            "crane is a robot of the server, and --tip is only for a URDF; send the arm's URDF or an edited description \
             with `torqued robot add` instead"
        );
    }
}

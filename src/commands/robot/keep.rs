//! Robots that a server keeps.

use std::process::ExitCode;

use clap::Args;
use wire::{RemovedRobot, Robot};

use crate::arguments::{OutputArguments, ServerArguments};
use crate::output::write_json;
use crate::robots::RobotArguments;

#[derive(Debug, Args)]
pub struct AddArguments {
    /// Its name in lists [default: the robot's own]
    #[arg(long, value_name = "NAME")]
    name: Option<String>,

    #[command(flatten)]
    robot: RobotArguments,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

#[derive(Debug, Args)]
pub struct RemoveArguments {
    /// Their ids
    #[arg(value_name = "ID", required = true)]
    ids: Vec<i64>,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

/// Sends a robot. It is read here first, so that a mistake is named with its file.
pub async fn add(arguments: AddArguments) -> anyhow::Result<ExitCode> {
    let AddArguments { name, robot, output, server } = arguments;
    let found = robot.read()?;
    let (media_type, text) = match &found.urdf {
        Some(urdf) => ("application/xml", urdf.text.clone()),
        None => ("application/json", serde_json::to_string(found.description())?),
    };
    let mut parameters = robot.parameters();
    parameters.extend(name.clone().map(|name| ("name", name)));
    let (robot, is_new) = server.client()?.add_robot(media_type, text, &parameters).await?;
    if output.json {
        write_json(&robot)?;
    } else {
        print!("{}", text_of(&robot, name.as_deref(), is_new));
    }
    Ok(ExitCode::SUCCESS)
}

fn text_of(robot: &Robot, given: Option<&str>, is_new: bool) -> String {
    let Robot { id, name, joints, .. } = robot;
    let exists = match given.filter(|given| given != name) {
        _ if is_new => String::new(),
        Some(given) => format!(", which the server had already: it keeps this name, not {given:?}"),
        None => ", which the server had already".to_owned(),
    };
    let mut text = format!(
        "robot {id}: {name}, {joints} joints{exists}\n\
         in a spec: \"robot\": {{\"model\": {{\"robot\": {id}}}}}\n"
    );
    text.extend(robot.doubts.iter().map(|doubt| format!("doubt: {doubt}\n")));
    text
}

pub async fn remove(arguments: RemoveArguments) -> anyhow::Result<ExitCode> {
    let client = arguments.server.client()?;
    for id in arguments.ids {
        let removed: RemovedRobot = client.delete(&format!("/v1/robots/{id}")).await?;
        if arguments.output.json {
            write_json(&removed)?;
        } else {
            println!("robot {id} is deleted; jobs keep their copies of its description");
        }
    }
    Ok(ExitCode::SUCCESS)
}

//! Prints the arm of a URDF as JSON: its description, doubts, and the links behind each joint. Or
//! writes a description, the URDF's own or another one, as a URDF or as a MuJoCo model.
//!
//! `describe FILE [--base LINK] [--tip LINK] [--lock JOINT=VALUE].. [--mount X,Y,Z,ROLL,PITCH,YAW]
//! [--nearest-physical] [--as json|urdf|mjcf] [--description FILE]`, lengths in m, angles of the
//! mount in degrees.

use std::error::Error;
use std::process::ExitCode;

use spec::{BaseDescription, RobotDescription};
use urdf::{Arm, Options};

fn main() -> ExitCode {
    match described(std::env::args().skip(1)) {
        Ok(text) => {
            print!("{text}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn described(mut arguments: impl Iterator<Item = String>) -> Result<String, Box<dyn Error>> {
    let mut options = Options::default();
    let mut file = None;
    let mut format = "json".to_owned();
    let mut description = None;
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or(format!("{argument} has no value"));
        match argument.as_str() {
            "--base" => options.base = Some(value()?),
            "--tip" => options.tip = Some(value()?),
            "--lock" => {
                let lock = value()?;
                let (joint, position) = lock.split_once('=').ok_or("a lock is JOINT=VALUE")?;
                options.locks.insert(joint.to_owned(), position.parse()?);
            }
            "--mount" => options.mount = mount(&value()?)?,
            "--as" => format = value()?,
            "--description" => description = Some(value()?),
            "--nearest-physical" => options.nearest_physical = true,
            _ => file = Some(argument),
        }
    }
    let text = std::fs::read_to_string(file.ok_or("which file?")?)?;
    let arm: Arm = urdf::read(&text, &options)?;
    let description: RobotDescription = match description {
        Some(file) => serde_json::from_str(&std::fs::read_to_string(file)?)?,
        None => arm.description.clone(),
    };
    match format.as_str() {
        "json" => Ok(format!("{}\n", serde_json::to_string(&arm)?)),
        "urdf" => Ok(urdf::write(&text, &arm, &description)?),
        "mjcf" => Ok(urdf::mjcf(&description, Some(&arm))?),
        _ => Err("--as json, urdf or mjcf".into()),
    }
}

fn mount(text: &str) -> Result<BaseDescription, Box<dyn Error>> {
    let numbers = text.split(',').map(str::parse).collect::<Result<Vec<f64>, _>>()?;
    let [x, y, z, roll, pitch, yaw] = numbers[..] else {
        return Err("a mount is X,Y,Z,ROLL,PITCH,YAW".into());
    };
    Ok(BaseDescription { position_m: [x, y, z], rpy_deg: [roll, pitch, yaw] })
}

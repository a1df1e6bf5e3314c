use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use clap::Args;
use figures::Size;
use reports::robot;
use spec::RobotSpec;

use super::reach::reach;
use crate::kept_robot::AnyRobotArguments;
use crate::output::write_json;
use crate::progress::measure;
use crate::robots::{Robot, Urdf};

/// In pixels.
const FIGURE_SIZE: Size = Size { width: 860, height: 480 };

#[derive(Debug, Args)]
pub struct Arguments {
    /// Print the description as JSON, for the field `robot.model` of a spec
    #[arg(long)]
    json: bool,

    /// Also draw the arm with all joints at 0, from its side and from its front, as SVG
    #[arg(long, value_name = "FILE")]
    figure: Option<PathBuf>,

    #[command(flatten)]
    robot: AnyRobotArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let robot = arguments.robot.read().await?;
    let nominal = dynamics::Robot::nominal(&RobotSpec::of(robot.model.clone()));
    if let Some(file) = &arguments.figure {
        let svg = urdf::zero_pose(robot.description(), robot.arm()).to_svg(FIGURE_SIZE)?;
        std::fs::write(file, svg).with_context(|| format!("cannot write {}", file.display()))?;
    }
    if arguments.json {
        for doubt in &robot.doubts {
            eprintln!("warning: {doubt}");
        }
        write_json(robot.description())?;
        return Ok(ExitCode::SUCCESS);
    }
    print!("{}", text(&robot, &nominal));
    Ok(ExitCode::SUCCESS)
}

/// The arm, its joints, its links and its doubts.
fn text(robot: &Robot, nominal: &dynamics::Robot) -> String {
    let description = robot.description();
    let mut text = format!("{}\n", description.name);
    if let Some(Urdf { text: file, arm }) = &robot.urdf {
        let size = measure::size(file.len() as u64);
        text += &format!("from link {} to link {} of a URDF of {size}\n", arm.base, arm.tip);
    }
    let base = description.base;
    if !base.is_upright() {
        let [x, y, z] = base.position_m.map(robot::place);
        let [roll, pitch, yaw] = base.rpy_deg.map(robot::place);
        text += &format!(
            "frame before the first joint at {x} {y} {z} m, turned by roll {roll}°, pitch {pitch}°, yaw {yaw}°\n"
        );
    }
    let limits = description.per_joint(|joint| joint.position_rad);
    let farthest = reach(&nominal.kinematics, &limits, base.position_m);
    let mass: f64 = nominal.links.iter().map(|link| link.mass).sum();
    text += &format!(
        "{} joints; the moving links weigh {} kg together\n",
        description.joints.len(),
        reports::numbers::value(mass)
    );
    text += &format!(
        "reach {farthest:.3} m: the largest distance of the hand from the frame before the first joint, within the \
         limits\n"
    );
    text += match nominal.has_compiled_kernels() {
        true => "simulated by the kernels compiled for the Panda's structure\n",
        false => "simulated by the general kernels\n",
    };
    text += &format!("\n{}", robot::joints(description).render());
    text += &format!("\n{}", robot::links(&urdf::links(description, robot.arm())).render());
    if !robot.doubts.is_empty() {
        text.push('\n');
    }
    text.extend(robot.doubts.iter().map(|doubt| format!("doubt: {doubt}\n")));
    text
}

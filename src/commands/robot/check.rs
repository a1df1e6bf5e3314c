use std::process::ExitCode;

use anyhow::Context;
use clap::Args;
use dynamics::DynamicsError;
use reports::{Align, Table};
use serde_json::json;
use spec::{JobSpec, RobotModel, SimulateSpec};

use super::survey::Survey;
use crate::exit::INTERRUPTED;
use crate::kept_robot::AnyRobotArguments;
use crate::output::write_json;
use crate::progress::{self, OwnWork, ProgressCallback, measure};

#[derive(Debug, Args)]
#[command(
    after_help = "A controller (computed-torque, 2 to 4 Hz) moves the arm from posture to posture, 0.5 to 1.5 a second, under \
                  gravity, without payload or friction. Open loop, the torques are multisines around 0.15 Hz and chirps \
                  around 0.3 Hz with their default amplitudes, as in the preset D1-mixed, and gravity is compensated. Robots \
                  and initial states vary as the description says."
)]
pub struct Arguments {
    /// Number of trajectories
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u64).range(1..=10_000_000))]
    trajectories: u64,

    /// Drive the arm by torques that do not depend on its motion; one with little damping is thrown into its limits
    #[arg(long)]
    open_loop: bool,

    /// Print the result as JSON, with the spec of the simulation
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    robot: AnyRobotArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let robot = arguments.robot.read().await?;
    let spec = simulation(&robot.model, arguments.trajectories, arguments.open_loop)?;
    // The check leaves friction out, whatever the robot has.
    let of_spec = spec.doubts().into_iter().filter(|doubt| doubt.field != "robot.friction");
    let of_spec = of_spec.map(|doubt| doubt.to_string());
    let doubts: Vec<String> = robot.doubts.iter().cloned().chain(of_spec).collect();
    let simulated = spec.clone();
    let work = move |progress: ProgressCallback<'_>| Survey::new(&simulated, progress);
    let survey =
        match progress::follow_own(OwnWork::on_trajectories("check", spec.trajectories), work)
            .await?
        {
            Err(DynamicsError::Cancelled { .. }) => {
                eprintln!("interrupted");
                return Ok(ExitCode::from(INTERRUPTED));
            }
            survey => survey?,
        };
    if arguments.json {
        let mut document = serde_json::to_value(&survey)?;
        document["doubts"] = json!(doubts);
        document["spec"] = serde_json::to_value(JobSpec::Simulate(spec))?;
        write_json(&document)?;
    } else {
        print!("{}", text(&survey, &spec));
        for doubt in doubts {
            println!("doubt: {doubt}");
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// A simulation of the robot as its description has it.
fn simulation(
    robot: &RobotModel,
    trajectories: u64,
    open_loop: bool,
) -> anyhow::Result<SimulateSpec> {
    let mut spec = json!({
        "kind": "simulate",
        "trajectories": trajectories,
        "observations": {"joint_velocities": true},
    });
    if open_loop {
        spec["excitation"] = json!({
            "chirp": {"frequency_hz": {"fixed": 0.3}},
            "multisine": {"frequency_hz": {"fixed": 0.15}},
        });
        spec["robot"] = json!({"model": robot, "gravity": "compensated"});
    } else {
        spec["excitation"] = json!({"via_points": {"frequency_hz": {"uniform": [0.5, 1.5]}}});
        spec["robot"] = json!({"model": robot});
        spec["controller"] = json!({"law": {"computed-torque": {"natural_frequency_hz": [2, 4]}}});
        spec["rate_hz"] = json!(100);
    }
    match spec::parse_json(spec).context("the arm cannot be simulated")? {
        JobSpec::Simulate(spec) => Ok(spec),
        other => unreachable!("a simulation became a job of kind {}", other.kind()),
    }
}

fn text(survey: &Survey, spec: &SimulateSpec) -> String {
    let Survey { draws, kept, diverged, lost, margin_rad, trajectories_per_second, .. } = *survey;
    let share = 100.0 * kept as f64 / draws as f64;
    let mut text =
        format!("{} of {} draws kept ({share:.1} %)", measure::count(kept), measure::count(draws));
    if let Some(margin) = margin_rad {
        let near = measure::count(draws - kept - diverged - lost);
        text += &format!("; {near} came within {margin} rad of a limit");
    }
    if spec.controller.is_some() {
        text += &format!("; {} lost their reference", measure::count(lost));
    }
    text += &format!("; {} diverged\n", measure::count(diverged));
    if let Some(rate) = trajectories_per_second {
        text += &format!(
            "{} trajectories/s of {} samples at {} Hz, with {} threads\n",
            measure::rounded(rate),
            spec.samples,
            spec.rate_hz,
            rayon::current_num_threads(),
        );
    }
    text += &format!("\n{}", table(survey).render());
    if kept == 0 && spec.controller.is_none() {
        text += "no draw was kept: torques alone do not hold an arm with little damping within its limits; leave out \
                 --open-loop, and give simulations a controller\n";
    } else if kept == 0 {
        text += "no draw was kept, so nothing is known about motions and torques within the limits; check the limits, \
                 the inertias and the initial state\n";
    }
    text
}

/// The joints: where their limits are, where they were in the draws that were kept, and which of
/// them ended the others.
fn table(survey: &Survey) -> Table {
    let headings = [
        "limits, °",
        "moved, °",
        "speed, rad/s",
        "limit, rad/s",
        "torque, N·m",
        "limit, N·m",
        "draws refused",
    ];
    let columns = headings.map(|heading| (heading, Align::Right));
    let mut table = Table::new([("joint", Align::Left)].into_iter().chain(columns));
    let range = |[from, to]: [f64; 2]| format!("{from:.1} to {to:.1}");
    for joint in &survey.joints {
        let number =
            |value: Option<f64>| value.map_or_else(|| "-".to_owned(), reports::numbers::value);
        table.push(vec![
            joint.name.clone(),
            range(joint.limits_deg),
            joint.moved_deg.map_or_else(|| "-".to_owned(), range),
            number(joint.fastest_rad_s),
            reports::numbers::value(joint.velocity_limit_rad_s),
            number(joint.largest_torque_nm),
            reports::numbers::value(joint.torque_limit_nm),
            measure::count(joint.refused),
        ]);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn most_draws_of_a_panda_are_kept_and_the_table_has_a_row_for_each_joint() {
        let spec = simulation(&RobotModel::panda(), 40, true).unwrap();
        let survey = Survey::new(&spec, &|_| std::ops::ControlFlow::Continue(())).unwrap();
        let text = text(&survey, &spec);
        assert!(text.contains("of 40 draws kept"), "{text}");
        assert!(text.contains("came within 0.01 rad of a limit; 0 diverged"), "{text}");
        assert!(text.contains("-166.0 to 166.0"), "{text}");
        assert_eq!(text.matches("panda_joint").count(), 7, "{text}");
    }

    #[test]
    fn a_robot_that_a_spec_refuses_is_refused_with_its_fields() {
        let mut description = RobotModel::panda().description().clone();
        description.joints[1].torque_nm = -1.0;
        let model = RobotModel::Described(Box::new(description));
        let message = crate::exit::message(&simulation(&model, 1, true).unwrap_err());
        assert!(message.contains("robot.model.joints[1].torque_nm is -1"), "{message}");
    }
}

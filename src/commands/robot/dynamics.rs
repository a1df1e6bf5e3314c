use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail, ensure};
use clap::{Args, ValueEnum};
use dynamics::{ArmState, Evaluation, Joints};
use serde::{Deserialize, Serialize};
use spec::{Gravity, Precision, RobotModel, RobotSpec};

use crate::kept_robot::AnyRobotArguments;
use crate::output::write_json;

/// The longest line of a state.
const LINE_BYTES: u64 = 64 << 10;

/// The largest position (rad) and speed (rad/s), up to which sines are exact.
const LARGEST_MOTION: f64 = 1e4;

/// N·m.
const LARGEST_TORQUE: f64 = 1e6;

#[derive(Debug, Args)]
#[command(
    after_help = "A state is a line {\"q\": [..], \"qd\": [..], \"u\": [..]} in rad, rad/s and N·m with a number for each \
                  joint; qd and u may be left out and are 0 then. Every state is answered by a line with qdd (rad/s²), \
                  gravity and bias (N·m), mass_matrix (kg·m²) and the pose of the hand in the world. Gravity is 9.81 m/s². \
                  qdd is under the torques u, with damping; mass_matrix has the armature. Friction and payload are left out."
)]
pub struct Arguments {
    /// States of the arm, one per line; `-` reads standard input [default: one state, all joints at 0]
    #[arg(long, value_name = "FILE")]
    states: Option<PathBuf>,

    /// The numbers to compute with, as `precision` of a simulation
    #[arg(long, value_enum, default_value_t = Format::F64)]
    precision: Format,

    #[command(flatten)]
    robot: AnyRobotArguments,
}

/// The format of numbers.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Format {
    F64,
    F32,
}

/// A line of the input.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct State {
    q: Vec<f64>,
    qd: Option<Vec<f64>>,
    u: Option<Vec<f64>>,
}

/// A line of the output.
#[derive(Debug, Serialize)]
struct Answer {
    qdd: Vec<f64>,
    gravity: Vec<f64>,
    bias: Vec<f64>,
    mass_matrix: Vec<Vec<f64>>,
    hand: Hand,
}

#[derive(Debug, Serialize)]
struct Hand {
    position_m: [f64; 3],
    quaternion_xyzw: [f64; 4],
}

pub async fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let Arguments { states, precision, robot } = arguments;
    let is_standard_input = states.as_ref().is_some_and(|file| file.as_os_str() == "-");
    ensure!(
        !(is_standard_input && robot.is_standard_input()),
        "both the arm and --states are read from standard input, allowed: one of them"
    );
    let arm = Arm::new(robot.read().await?.model, *precision);
    let Some(file) = states else {
        let q = vec![0.0; arm.robot.joints()];
        write_json(&arm.answer(&State { q, qd: None, u: None })?)?;
        return Ok(ExitCode::SUCCESS);
    };
    if is_standard_input {
        let answer = |answer: &Answer| Ok(write_json(answer)?);
        arm.answer_lines(std::io::stdin().lock(), Path::new("standard input"), answer)?;
    } else {
        let lines = File::open(file).with_context(|| format!("cannot read {}", file.display()))?;
        let answer = |answer: &Answer| Ok(write_json(answer)?);
        arm.answer_lines(BufReader::new(lines), file, answer)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// An arm whose dynamics are asked for.
struct Arm {
    robot: dynamics::Robot,
    precision: Precision,
}

impl Arm {
    /// The nominal arm with gravity.
    fn new(model: RobotModel, precision: Format) -> Self {
        let spec = RobotSpec { gravity: Gravity::On, ..RobotSpec::of(model) };
        let precision = match precision {
            Format::F64 => Precision::F64,
            Format::F32 => Precision::F32,
        };
        Self { robot: dynamics::Robot::nominal(&spec), precision }
    }

    /// Gives the answer to every line to `write`. Empty lines are passed over.
    fn answer_lines(
        &self,
        mut lines: impl BufRead,
        file: &Path,
        mut write: impl FnMut(&Answer) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let mut line = Vec::new();
        for number in 1_u64.. {
            line.clear();
            lines
                .by_ref()
                .take(LINE_BYTES)
                .read_until(b'\n', &mut line)
                .with_context(|| format!("cannot read {}", file.display()))?;
            if line.is_empty() {
                break;
            }
            let place = || format!("{}, line {number}", file.display());
            ensure!(
                line.len() as u64 != LINE_BYTES || line.ends_with(b"\n"),
                "{} is longer than {LINE_BYTES} bytes, allowed: one state",
                place()
            );
            if line.trim_ascii().is_empty() {
                continue;
            }
            let state: State = serde_json::from_slice(&line).with_context(place)?;
            write(&self.answer(&state).with_context(place)?)?;
        }
        Ok(())
    }

    fn answer(&self, State { q, qd, u }: &State) -> anyhow::Result<Answer> {
        let q = self.per_joint("q", Some(q), LARGEST_MOTION)?;
        let qd = self.per_joint("qd", qd.as_deref(), LARGEST_MOTION)?;
        let u = self.per_joint("u", u.as_deref(), LARGEST_TORQUE)?;
        let evaluation = Evaluation::new(&self.robot, self.precision, &ArmState { q, qd }, u);
        ensure!(
            evaluation.qdd.iter().chain(&evaluation.bias).all(|value| value.is_finite()),
            "the result is not finite: the arm is too light, or the state too fast"
        );
        let pose = self.robot.kinematics.end_effector_pose(q);
        Ok(Answer {
            qdd: evaluation.qdd.to_vec(),
            gravity: evaluation.gravity.to_vec(),
            bias: evaluation.bias.to_vec(),
            mass_matrix: evaluation.mass_matrix.iter().map(|row| row.to_vec()).collect(),
            hand: Hand { position_m: pose.position_m, quaternion_xyzw: pose.quaternion_xyzw },
        })
    }

    /// The values of a field, 0 if it is left out.
    fn per_joint(
        &self,
        field: &str,
        values: Option<&[f64]>,
        largest: f64,
    ) -> anyhow::Result<Joints<f64>> {
        let joints = self.robot.joints();
        let Some(values) = values else { return Ok(Joints::splat(joints, 0.0)) };
        ensure!(
            values.len() == joints,
            "{field} has {} numbers, allowed: {joints}, one for each joint",
            values.len()
        );
        for (index, value) in values.iter().enumerate() {
            if value.abs() > largest {
                bail!("{field}[{index}] is {value}, allowed: {} to {largest}", -largest);
            }
        }
        Ok(values.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answers(lines: &str, precision: Format) -> anyhow::Result<Vec<Answer>> {
        let mut answers = Vec::new();
        let arm = Arm::new(RobotModel::panda(), precision);
        arm.answer_lines(lines.as_bytes(), Path::new("states.jsonl"), |answer| {
            let copy = serde_json::to_value(answer)?;
            let list = |field: &str| serde_json::from_value(copy[field].clone());
            answers.push(Answer {
                qdd: list("qdd")?,
                gravity: list("gravity")?,
                bias: list("bias")?,
                mass_matrix: serde_json::from_value(copy["mass_matrix"].clone())?,
                hand: Hand { ..answer.hand },
            });
            Ok(())
        })?;
        Ok(answers)
    }

    fn refused(lines: &str) -> String {
        crate::exit::message(&answers(lines, Format::F64).unwrap_err())
    }

    #[test]
    fn the_torques_of_gravity_hold_the_arm_still() {
        let held = answers("{\"q\": [0.1, -0.4, 0.3, -2, 0.2, 1.5, 0.7]}\n", Format::F64).unwrap();
        let state = serde_json::json!({
            "q": [0.1, -0.4, 0.3, -2, 0.2, 1.5, 0.7], "u": held[0].gravity,
        });
        for precision in [Format::F64, Format::F32] {
            let still = answers(&format!("\n{state}\n\n{state}"), precision).unwrap();
            assert_eq!(still.len(), 2);
            let most = if matches!(precision, Format::F64) { 1e-10 } else { 0.05 };
            assert!(still[1].qdd.iter().all(|qdd| qdd.abs() < most), "{:?}", still[1].qdd);
        }
        assert_eq!(held[0].bias, held[0].gravity);
        assert_eq!(held[0].mass_matrix.len(), 7);
        assert!((held[0].mass_matrix[2][5] - held[0].mass_matrix[5][2]).abs() < 1e-15);
        assert!(held[0].hand.position_m[0] > 0.2);
    }

    #[test]
    fn a_wrong_line_is_named_with_its_field() {
        let right = "{\"q\": [0, 0, 0, 0, 0, 0, 0]}";
        let message = refused(&format!("{right}\n{{\"q\": [1, 2]}}"));
        assert_eq!(
            message,
            "states.jsonl, line 2: q has 2 numbers, allowed: 7, one for each joint"
        );
        let message = refused(&right.replace('}', ", \"u\": [0, 0, 2e6, 0, 0, 0, 0]}"));
        assert!(message.ends_with("u[2] is 2000000, allowed: -1000000 to 1000000"), "{message}");
        assert!(refused(&right.replace("\"q\"", "\"p\"")).contains("line 1: unknown field `p`"));
        assert!(refused("{\"q\": [1e999]}").contains("line 1: "));
        assert!(refused("0 0 0 0 0 0 0").contains("line 1: "));
        let long = " ".repeat(usize::try_from(LINE_BYTES).unwrap());
        assert!(refused(&long).contains("line 1 is longer than 65536 bytes"));
    }
}

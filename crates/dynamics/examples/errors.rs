//! Prints the error of each integration scheme, for every damping, gravity, friction and
//! excitation: the 99th percentile over trajectories of the largest position error, in rad. Only
//! trajectories that keep clear of the joint limits count, as in a dataset. Where none does, all
//! count. The first column of numbers is their share.
//!
//! `cargo run --release -p dynamics --example errors -- [TRAJECTORIES] [DAMPING ..]`

use std::ops::ControlFlow;

use dynamics::{DynamicsError, simulate};
use serde_json::{Value, json};
use spec::{Integrator, JobSpec, Precision, SimulateSpec};

/// Joints of the Panda.
const JOINTS: usize = 7;

/// The reference solution. It is accurate where any scheme can follow the motion. [`CONTROL`] shows
/// where none can.
const SOLUTION: Integrator = Integrator::Rk4 { substeps: 64 };
const CONTROL: Integrator = Integrator::Extrapolated { order: 4, substeps: 24 };

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let count: u64 = arguments.next().map_or(Ok(256), |count| count.parse())?;
    let all = usize::try_from(count)?;
    let mut dampings: Vec<f64> =
        arguments.map(|damping| damping.parse()).collect::<Result<_, _>>()?;
    if dampings.is_empty() {
        dampings = vec![0.0, 0.1, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0];
    }
    let extrapolated = |order, substeps| Integrator::Extrapolated { order, substeps };
    let schemes = [
        ("control", CONTROL, Precision::F64),
        ("default", Integrator::default(), Precision::F32),
        ("default64", Integrator::default(), Precision::F64),
        ("order 3", extrapolated(3, 1), Precision::F32),
        ("2 steps", extrapolated(4, 2), Precision::F32),
        ("4 steps", extrapolated(4, 4), Precision::F32),
        ("rk4 6", Integrator::Rk4 { substeps: 6 }, Precision::F32),
        ("rk4 12", Integrator::Rk4 { substeps: 12 }, Precision::F32),
        ("rk4 24", Integrator::Rk4 { substeps: 24 }, Precision::F32),
        ("reference", Integrator::Reference, Precision::F32),
    ];
    print!(
        "{:>7} {:<11} {:<8} {:<15} {:>5}",
        "damping", "gravity", "friction", "excitation", "share"
    );
    schemes.iter().for_each(|(name, ..)| print!(" {name:>9}"));
    println!();
    for damping in dampings {
        for gravity in ["off", "compensated", "on"] {
            for friction in [false, true] {
                for (family, frequency) in [("chirp", 0.3), ("multisine", 0.1), ("multisine", 0.3)]
                {
                    let spec = json!({
                        "kind": "simulate", "trajectories": count, "seed": 3,
                        "excitation": {family: {"frequency_hz": {"fixed": frequency}}},
                        "robot": {
                            "damping_nm_s_rad": vec![damping; JOINTS],
                            "gravity": gravity,
                            "friction": if friction { json!({}) } else { Value::Null },
                        },
                        "rejection": {"position_margin_rad": null},
                    });
                    let JobSpec::Simulate(spec) = spec::parse(spec.to_string().as_bytes())? else {
                        return Err("not a simulation".into());
                    };
                    print!("{damping:>7} {gravity:<11} {friction:<8} {family:<10}{frequency:<5}");
                    let solution = positions(&spec, SOLUTION, Precision::F64)?;
                    let kept = kept(&solution, &spec);
                    print!(" {:>5.2}", kept.len() as f64 / count as f64);
                    let kept = if kept.is_empty() { (0..all).collect() } else { kept };
                    for (_, integrator, precision) in schemes {
                        match positions(&spec, integrator, precision) {
                            Ok(q) => print!(" {:>9.1e}", error(&q, &solution, &kept, &spec)),
                            Err(DynamicsError::NotFinite { .. }) => print!(" {:>9}", "infinite"),
                            Err(other) => return Err(other.into()),
                        }
                    }
                    println!();
                }
            }
        }
    }
    Ok(())
}

fn positions(
    spec: &SimulateSpec,
    integrator: Integrator,
    precision: Precision,
) -> Result<Vec<f32>, DynamicsError> {
    let spec = SimulateSpec { integrator, precision, ..spec.clone() };
    Ok(simulate(&spec, 0..spec.trajectories, &|_| ControlFlow::Continue(()))?.series.y().to_vec())
}

/// Trajectories that stay clear of the joint limits.
fn kept(q: &[f32], spec: &SimulateSpec) -> Vec<usize> {
    let limits = spec.robot.description().per_joint(|joint| joint.position_rad);
    let inside =
        |sample: &[f32]| sample.iter().zip(&limits).all(|(&q, limits)| limits.contains(q.into()));
    let rows = q.chunks_exact(spec.samples as usize * JOINTS).enumerate();
    let clear = rows.filter(|(_, q)| q.chunks_exact(JOINTS).all(inside));
    clear.map(|(row, _)| row).collect()
}

/// The 99th percentile of the largest errors of trajectories `kept`.
fn error(q: &[f32], solution: &[f32], kept: &[usize], spec: &SimulateSpec) -> f32 {
    let len = spec.samples as usize * JOINTS;
    let largest = |row: &usize| {
        let (q, solution) = (&q[row * len..][..len], &solution[row * len..][..len]);
        q.iter().zip(solution).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    let mut errors: Vec<f32> = kept.iter().map(largest).collect();
    errors.sort_by(f32::total_cmp);
    errors.get(errors.len() * 99 / 100).copied().unwrap_or(f32::NAN)
}

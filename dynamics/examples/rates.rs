//! Prints how fast this machine simulates the default dataset, per instruction set and precision.
//!
//! `cargo run --release -p dynamics --example rates`

use std::ops::ControlFlow;
use std::time::Instant;

use dynamics::{DynamicsError, InstructionSet, simulate_on};
use spec::{Integrator, JobSpec, Precision, SimulateSpec};

/// Evaluations of the dynamics per sample with the default integrator.
const EVALUATIONS: f64 = 10.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let spec = br#"{
        "kind": "simulate", "trajectories": 1000000, "seed": 1,
        "excitation": {"multisine": {"frequency_hz": {"uniform": [0.05, 0.15]}}}
    }"#;
    let JobSpec::Simulate(spec) = spec::parse(spec)? else { return Err("not a simulation".into()) };
    let dense = SimulateSpec {
        integrator: Integrator::Extrapolated { order: 4, substeps: 20 },
        ..spec.clone()
    };

    println!("{:<10} {:<4} {:>7} {:>15} {:>12}", "", "", "threads", "trajectories/s", "M evals/s");
    for instructions in InstructionSet::available() {
        for precision in [Precision::F32, Precision::F64] {
            for threads in [1, 2] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
                let rate = |spec: &SimulateSpec, count| {
                    let spec = SimulateSpec { precision, ..spec.clone() };
                    pool.install(|| rate(instructions, &spec, count))
                };
                // Portable lanes are an order of magnitude slower where `mul_add` is a library call.
                let portable = Some(&instructions) == InstructionSet::available().last();
                let count = if portable { 200 } else { 6000 };
                let trajectories = rate(&spec, count)?;
                let evaluations = rate(&dense, count / 20)? * 400.0 * 20.0 * EVALUATIONS;
                println!(
                    "{:<10} {:<4} {threads:>7} {trajectories:>15.0} {:>12.1}",
                    instructions.to_string(),
                    format!("{precision:?}"),
                    evaluations / 1e6
                );
            }
        }
    }
    Ok(())
}

/// Trajectories per second, the best of three.
fn rate(
    instructions: InstructionSet,
    spec: &SimulateSpec,
    count: u64,
) -> Result<f64, DynamicsError> {
    let mut best: f64 = 0.0;
    for _ in 0..3 {
        let start = Instant::now();
        simulate_on(instructions, spec, 0..count, &|_| ControlFlow::Continue(()))?;
        best = best.max(count as f64 / start.elapsed().as_secs_f64());
    }
    Ok(best)
}

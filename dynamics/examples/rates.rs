//! Prints how fast this machine simulates, per instruction set and precision.
//!
//! `cargo run --release -p dynamics --example rates [-- [--json] [SPEC]]`
//!
//! SPEC is a simulate job to take instead of the default one. `--json` measures the best
//! instruction set alone, each rate once, and prints an array: whoever compares with other
//! programs runs all of them in turn, again and again, and takes medians.

use std::ops::ControlFlow;
use std::time::Instant;

use dynamics::{DynamicsError, InstructionSet, simulate_on};
use spec::{Integrator, JobSpec, Precision, SimulateSpec};

const DEFAULT_SPEC: &str = r#"{
    "kind": "simulate", "trajectories": 1000000, "seed": 1,
    "excitation": {"multisine": {"frequency_hz": {"uniform": [0.05, 0.15]}}}
}"#;

/// Evaluations of the dynamics per step with the default integrator.
const EVALUATIONS: f64 = 10.0;
/// Steps per sample when it is the dynamics that are measured, and not drawing and sampling.
const DENSE: u32 = 20;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut json = false;
    let mut text = DEFAULT_SPEC.to_owned();
    for argument in std::env::args().skip(1) {
        match argument.as_str() {
            "--json" => json = true,
            file => text = std::fs::read_to_string(file)?,
        }
    }
    let JobSpec::Simulate(spec) = spec::parse(text.as_bytes())? else {
        return Err("not a simulation".into());
    };
    if json {
        let rates = measure(&spec, InstructionSet::best(), 1)?;
        println!("{}", serde_json::Value::from_iter(rates.iter().map(Rates::json)));
        return Ok(());
    }
    println!("{:<10} {:<4} {:>7} {:>15} {:>12}", "", "", "threads", "trajectories/s", "M evals/s");
    for instructions in InstructionSet::available() {
        for rates in measure(&spec, instructions, 3)? {
            println!(
                "{:<10} {:<4} {:>7} {:>15.0} {:>12.1}",
                rates.instructions.to_string(),
                format!("{:?}", rates.precision),
                rates.threads,
                rates.trajectories,
                rates.evaluations / 1e6
            );
        }
    }
    Ok(())
}

/// What one instruction set does per second.
struct Rates {
    instructions: InstructionSet,
    precision: Precision,
    threads: usize,
    trajectories: f64,
    evaluations: f64,
}

impl Rates {
    fn json(&self) -> serde_json::Value {
        serde_json::json!({
            "instructions": self.instructions.to_string(),
            "precision": self.precision,
            "threads": self.threads,
            "trajectories_per_s": self.trajectories,
            "evaluations_per_s": self.evaluations,
        })
    }
}

fn measure(
    spec: &SimulateSpec,
    instructions: InstructionSet,
    repetitions: u32,
) -> Result<Vec<Rates>, Box<dyn std::error::Error>> {
    let integrator = Integrator::Extrapolated { order: 4, substeps: DENSE };
    let dense = SimulateSpec { integrator, ..spec.clone() };
    // Portable lanes are an order of magnitude slower where `mul_add` is a library call.
    let portable = Some(&instructions) == InstructionSet::available().last();
    let count = if portable { 160 } else { 6400 };
    let mut all = Vec::new();
    for precision in [Precision::F32, Precision::F64] {
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
            let best = |spec: &SimulateSpec, count| {
                let spec = SimulateSpec { precision, ..spec.clone() };
                pool.install(|| best_rate(instructions, &spec, count, repetitions))
            };
            let trajectories = best(spec, count)?;
            let steps = f64::from(spec.samples) * f64::from(DENSE);
            let evaluations = best(&dense, count / 10)? * steps * EVALUATIONS;
            all.push(Rates { instructions, precision, threads, trajectories, evaluations });
        }
    }
    Ok(all)
}

/// Trajectories per second, the best of several.
fn best_rate(
    instructions: InstructionSet,
    spec: &SimulateSpec,
    count: u64,
    repetitions: u32,
) -> Result<f64, DynamicsError> {
    let mut best: f64 = 0.0;
    for _ in 0..repetitions {
        let start = Instant::now();
        simulate_on(instructions, spec, 0..count, &|_| ControlFlow::Continue(()))?;
        best = best.max(count as f64 / start.elapsed().as_secs_f64());
    }
    Ok(best)
}

//! Prints how fast this machine simulates, per instruction set and precision.
//!
//! `cargo run --release -p dynamics --example rates -- [--json] [SPEC] [SET] [PRECISION] [THREADS ..]`
//!
//! The rate of trajectories includes draws, excitation, rejection and output, into fresh memory and
//! into memory used before. The rate of evaluations is that of Runge-Kutta. Each evaluation is
//! complete: mass matrix, bias forces, factorization, solution, and the update of the state.
//!
//! SPEC is a file with a simulate job that replaces the default one. SET, such as `AVX2`, is the
//! only instruction set to measure, and PRECISION, `f32` or `f64`, the only precision. `--json` measures the set in use, which is the fastest unless
//! `TORQUED_INSTRUCTIONS` names another, and measures each rate only twice. `cargo xtask bench
//! dynamics` uses it and lets this program and other simulators take turns.

use std::ops::ControlFlow;
use std::time::Instant;

use dynamics::{DynamicsError, InstructionSet, Trajectories, simulate_into};
use serde_json::{Value, json};
use spec::{Integrator, JobSpec, Precision, SimulateSpec};

const DEFAULT_SPEC: &str = r#"{
    "kind": "simulate", "trajectories": 1000000, "seed": 1,
    "excitation": {"multisine": {"frequency_hz": {"uniform": [0.05, 0.15]}}}
}"#;

const SUBSTEPS: u32 = 50;
/// Evaluations per step of Runge-Kutta.
const EVALUATIONS: u32 = 4;
/// Vector operations per evaluation, which a test of the crate counts (`src/operations.rs`). The
/// multiply-add units of a processor do one operation per lane and cycle. So the rate of evaluations
/// times this number over the rate of multiply-adds is the share of the processor's peak.
const OPERATIONS_PER_EVALUATION: f64 = 1018.5;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut json = false;
    let mut text = DEFAULT_SPEC.to_owned();
    let mut threads: Vec<usize> = Vec::new();
    let mut sets = InstructionSet::available();
    let mut precisions = vec![Precision::F32, Precision::F64];
    for argument in std::env::args().skip(1) {
        if argument == "--json" {
            json = true;
        } else if let Ok(count) = argument.parse() {
            threads.push(count);
        } else if let Ok(set) = argument.parse() {
            sets = vec![set];
        } else if let Ok(precision) = serde_json::from_value(json!(argument)) {
            precisions = vec![precision];
        } else {
            text = std::fs::read_to_string(argument)?;
        }
    }
    if threads.is_empty() {
        threads = vec![1, 2];
    }
    let JobSpec::Simulate(spec) = spec::parse(text.as_bytes())? else {
        return Err("not a simulation".into());
    };
    if json {
        let rates = measure(&spec, InstructionSet::best(), &precisions, &threads, 2)?;
        println!("{}", Value::from_iter(rates.iter().map(Rates::json)));
        return Ok(());
    }
    println!(
        "{:<10} {:<4} {:>7} {:>16} {:>16} {:>12}",
        "", "", "threads", "trajectories/s", "in used memory", "M evals/s"
    );
    for instructions in sets {
        for rates in measure(&spec, instructions, &precisions, &threads, 4)? {
            println!(
                "{:<10} {:<4} {:>7} {:>16.0} {:>16.0} {:>12.1}",
                rates.instructions.to_string(),
                format!("{:?}", rates.precision),
                rates.threads,
                rates.trajectories.fresh,
                rates.trajectories.used,
                rates.evaluations / 1e6
            );
        }
    }
    Ok(())
}

/// The rates of one instruction set, per second.
struct Rates {
    instructions: InstructionSet,
    precision: Precision,
    threads: usize,
    trajectories: Trajectory,
    evaluations: f64,
}

/// Trajectories per second, by the memory they are written to.
struct Trajectory {
    fresh: f64,
    used: f64,
}

impl Rates {
    fn json(&self) -> Value {
        json!({
            "instructions": self.instructions.to_string(),
            "precision": self.precision,
            "threads": self.threads,
            "trajectories_per_s": self.trajectories.fresh,
            "trajectories_in_used_memory_per_s": self.trajectories.used,
            "evaluations_per_s": self.evaluations,
            "operations_per_evaluation": OPERATIONS_PER_EVALUATION,
        })
    }
}

fn measure(
    spec: &SimulateSpec,
    instructions: InstructionSet,
    precisions: &[Precision],
    threads: &[usize],
    repetitions: u32,
) -> Result<Vec<Rates>, Box<dyn std::error::Error>> {
    // Portable lanes are an order of magnitude slower where `mul_add` is a library call.
    let portable = Some(&instructions) == InstructionSet::available().last();
    let count = match (portable, &spec.controller) {
        (true, _) => 160,
        // A step for every control period takes longer.
        (false, Some(_)) => 1600,
        (false, None) => 6400,
    };
    let per_trajectory = f64::from((spec.samples - 1) * SUBSTEPS * EVALUATIONS);
    let mut all = Vec::new();
    for &precision in precisions {
        let spec = SimulateSpec { precision, ..spec.clone() };
        let integrator = Integrator::Rk4 { substeps: SUBSTEPS };
        let dense = SimulateSpec { integrator, ..spec.clone() };
        for &threads in threads {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
            let best = |spec, count| pool.install(|| best(instructions, spec, count, repetitions));
            let trajectories = best(&spec, count)?;
            // Under control, steps are short anyway, and controllers take a part of the time.
            let evaluations = match spec.controller {
                None => best(&dense, count / 20)?.used * per_trajectory,
                Some(_) => f64::NAN,
            };
            all.push(Rates { instructions, precision, threads, trajectories, evaluations });
        }
    }
    Ok(all)
}

/// The best of several runs in fresh and in used memory.
fn best(
    instructions: InstructionSet,
    spec: &SimulateSpec,
    count: u64,
    repetitions: u32,
) -> Result<Trajectory, DynamicsError> {
    let rate = |trajectories: &mut Trajectories| {
        let start = Instant::now();
        let go_on = |_| ControlFlow::Continue(());
        simulate_into(instructions, spec, 0..count, &go_on, trajectories)?;
        Ok(count as f64 / start.elapsed().as_secs_f64())
    };
    let mut reused = Trajectories::default();
    let mut best = Trajectory { fresh: 0.0, used: 0.0 };
    for _ in 0..repetitions {
        best.fresh = best.fresh.max(rate(&mut Trajectories::default())?);
        best.used = best.used.max(rate(&mut reused)?);
    }
    Ok(best)
}

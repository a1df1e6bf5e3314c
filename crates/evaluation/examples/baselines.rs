//! Prints the results of each baseline on the test grids: mean RMSE in degrees per frequency, and
//! time per scenario on all threads.
//!
//! ```sh
//! cargo run --release --example baselines -- [multisine|chirp] [scenarios per frequency] [ROBOT as JSON]
//! ```

#![expect(clippy::unwrap_used, reason = "an example that cannot go on panics")]

use std::ops::ControlFlow;
use std::time::Instant;

use evaluation::{NominalArm, baseline, rmse_deg};
use serde_json::json;
use series::Series;
use spec::{Baseline, DataSpec, JobSpec, SimulateSpec};

const CONTEXT: usize = 320;

fn main() {
    let mut arguments = std::env::args().skip(1);
    let family = arguments.next().unwrap_or_else(|| "multisine".to_owned());
    let count: u64 = arguments.next().map_or(100, |text| text.parse().unwrap());
    let robot = arguments.next().unwrap_or_else(|| "{}".to_owned());
    let grid: &[f64] = match family.as_str() {
        "chirp" => &[0.1, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0],
        // The frequencies of the quickstart.
        _ => &[0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.45],
    };
    let text = json!({
        "preset": format!("grid-{family}"),
        "trajectories": count * grid.len() as u64,
        "excitation": {&family: {"frequency_hz": {"grid": grid}}},
        "robot": serde_json::from_str::<serde_json::Value>(&robot).unwrap(),
    });
    let JobSpec::Simulate(spec) = spec::parse(text.to_string().as_bytes()).unwrap() else {
        panic!("not a simulation")
    };
    let arm = NominalArm::of(&DataSpec::Simulation(spec.clone()));
    let cells: Vec<Series> =
        spec.cells().iter().map(|cell| scenarios(&spec, cell.first, cell.count)).collect();

    print!("{:<26}", "Hz");
    grid.iter().for_each(|frequency| print!("{frequency:>9}"));
    println!("{:>14}", "ms/scenario");
    for name in Baseline::all() {
        let predictor = baseline(name, &arm);
        let begin = Instant::now();
        print!("{:<26}", predictor.name());
        for cell in &cells {
            let predicted = predictor.predict(&cell.observed(CONTEXT)).unwrap();
            let errors = rmse_deg(&cell.view(), CONTEXT, &predicted);
            print!("{:>9.4}", errors.iter().sum::<f64>() / errors.len() as f64);
        }
        let scenarios = cells.iter().map(|cell| cell.robots()).sum::<usize>() as f64;
        println!("{:>14.3}", begin.elapsed().as_secs_f64() * 1e3 / scenarios);
    }
}

fn scenarios(spec: &SimulateSpec, first: u64, count: u64) -> Series {
    let go_on = |_| ControlFlow::Continue(());
    dynamics::simulate(spec, first..first + count, &go_on).unwrap().series
}

//! Predictions for a single trajectory: one pass of the network, and whole chains of samplers.

use super::measurement::{Goal, Measurement};
use super::networks::{self, Network, Rounds, Subject, Twin};
use super::wanted::{BenchmarkResults, Wanted};

const SUBJECT: Subject = Subject {
    name: "inference",
    pointer: "/pass_ms/p50",
    has_batches: false,
    small: Rounds { count: 5, steps: 6 },
    paper: Rounds { count: 3, steps: 1 },
};

pub(super) fn run(wanted: Wanted) -> anyhow::Result<BenchmarkResults> {
    networks::run(&SUBJECT, wanted, rows)
}

fn rows(network: &Network) -> Vec<Measurement> {
    let pass = match network.architecture {
        "robomorph" | "cdt" => Goal::AtMost(0.5),
        _ => Goal::AtMost(0.6),
    };
    let mut rows = Vec::new();
    for (what, key, goal) in [
        ("pass", "pass_ms", Some(pass)),
        ("DDIM, 5 steps", "ddim_5_ms", None),
        ("DDPM, 100 steps", "ddpm_100_ms", None),
    ] {
        for quantile in ["p50", "p99"] {
            let pointer = format!("/{key}/{quantile}");
            let Some(ours) = network.ours(&pointer) else { continue };
            let name = format!("{} {what}, {quantile}", network.name);
            let goal = goal.filter(|_| quantile == "p50");
            let eager = network.twin(Twin::Eager, &pointer);
            rows.push(Measurement::compared(&name, ours, eager, "ms", goal));
            for twin in [Twin::Compiled, Twin::Autocast] {
                if let Some(twin) = network.twin(twin, &pointer) {
                    rows.push(Measurement::compared(&name, ours, Some(twin), "ms", None));
                }
            }
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::super::networks::tests::network;
    use super::rows;

    #[test]
    fn medians_of_passes_are_held_to_a_goal_and_chains_that_were_not_run_have_no_rows() {
        let times = |ms: f64| json!({"pass_ms": {"p50": ms, "p99": 2.0 * ms}});
        let rows = rows(&network(&[(times(6.0), Some(times(10.0)))]));
        let found: Vec<_> =
            rows.iter().map(|row| (row.name.as_str(), row.ratio, row.met)).collect();
        let expected = [
            ("cdt-small pass, p50", Some(0.6), Some(false)),
            ("cdt-small pass, p99", Some(0.6), None),
        ];
        assert_eq!(found, expected);
    }
}

//! Training steps: their time, their memory, and their share of the
//! processor's multiply-adds by PyTorch's count.

use super::isa;
use super::measurement::{Goal, Measurement};
use super::networks::{self, Network, Rounds, Subject, Twin};
use super::wanted::{BenchmarkResults, Wanted};

const SUBJECT: Subject = Subject {
    name: "training",
    pointer: "/step_ms",
    has_batches: true,
    small: Rounds { count: 7, steps: 4 },
    paper: Rounds { count: 3, steps: 1 },
};

/// Ratio to the memory of eager PyTorch.
const MEMORY: Goal = Goal::AtMost(0.6);

pub(super) fn run(wanted: Wanted) -> anyhow::Result<BenchmarkResults> {
    networks::run(&SUBJECT, wanted, rows)
}

fn rows(network: &Network) -> Vec<Measurement> {
    let of = &network.name;
    let step = match network.architecture {
        "robomorph" => isa::bound(0.45, 0.60),
        "cdt" => isa::bound(0.40, 0.55),
        _ => 0.60,
    };
    let step = Goal::AtMost(step);
    let mut rows = Vec::new();
    for (what, pointer, unit, goal) in
        [("step", "/step_ms", "ms", step), ("memory", "/peak_memory_mib", "MiB", MEMORY)]
    {
        let Some(ours) = network.ours(pointer) else { continue };
        let name = format!("{of} {what}");
        let eager = network.twin(Twin::Eager, pointer);
        rows.push(Measurement::compared(&name, ours, eager, unit, Some(goal)));
        for twin in [Twin::Compiled, Twin::Autocast] {
            if let Some(twin) = network.twin(twin, pointer) {
                rows.push(Measurement::compared(&name, ours, Some(twin), unit, None));
            }
        }
    }
    if let (Some(step_ms), Some(counted)) =
        (network.ours("/step_ms"), network.twin(Twin::Eager, "/multiply_adds"))
    {
        let share = 100.0 * counted.value / (step_ms / 1e3) / network.peak();
        rows.push(Measurement::alone(format!("{of} share of peak"), share, "%", None));
    }
    rows
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::super::networks::tests::network;
    use super::rows;

    #[test]
    fn steps_and_memory_are_held_to_their_goals() {
        let times = |ms: f64| json!({"step_ms": ms, "peak_memory_mib": 100.0});
        let mut theirs = times(10.0);
        theirs["multiply_adds"] = 1e5.into();
        let rows = rows(&network(&[(times(4.0), Some(theirs))]));
        let found: Vec<_> =
            rows.iter().map(|row| (row.name.as_str(), row.ratio, row.met)).collect();
        let expected = [
            ("cdt-small step", Some(0.4), Some(true)),
            ("cdt-small memory", Some(1.0), Some(false)),
            ("cdt-small share of peak", None, None),
        ];
        assert_eq!(found, expected);
        // 1e5 in 4 ms, with a peak of 1e8 per second.
        assert_eq!(rows[2].ours, 25.0);
    }
}

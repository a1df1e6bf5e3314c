//! The same spec gives the same bytes.
//!
//! The digests below are of the values themselves. They change only when the science changes
//! (draws, parameters, integrator), and such a change belongs into the changelog. Datasets are
//! found by the digest of their spec, and an old one would no longer be the one that its spec
//! produces.

use std::ops::ControlFlow;

use dynamics::{InstructionSet, Trajectories, simulate_on};
use serde_json::json;
use sha2::{Digest, Sha256};
use spec::SimulateSpec;

use super::{mixed, run, spec};

use crate::JOINTS;

fn small(precision: &str) -> SimulateSpec {
    spec(
        &mixed(),
        &json!({
            "samples": 120,
            "precision": precision,
            // Wide, so that lanes are often filled again.
            "rejection": {"position_margin_rad": 1.0},
        }),
    )
}

pub(crate) fn digest(trajectories: &Trajectories) -> String {
    let mut hash = Sha256::new();
    let recorded = [trajectories.series.u(), trajectories.series.y()];
    let more = [trajectories.qd.as_deref(), trajectories.end_effector.as_deref()];
    for values in recorded.into_iter().chain(more.into_iter().flatten()) {
        for value in values {
            hash.update(value.to_le_bytes());
        }
    }
    hex::encode(hash.finalize())
}

fn run_on(instructions: InstructionSet, spec: &SimulateSpec, count: u64) -> Trajectories {
    simulate_on(instructions, spec, 0..count, &|_| ControlFlow::Continue(())).unwrap()
}

#[test]
fn every_instruction_set_gives_the_same_bits() {
    for precision in ["f32", "f64"] {
        let spec = small(precision);
        let best = run_on(InstructionSet::best(), &spec, 70);
        assert!(best.rejected > 0);
        for instructions in InstructionSet::available() {
            assert!(run_on(instructions, &spec, 70) == best, "{instructions}, {precision}");
        }
    }
}

#[test]
fn any_way_to_split_a_range_gives_the_same_trajectories() {
    let spec = small("f32");
    let whole = run(&spec, 0..300);
    let row = spec.samples as usize * JOINTS;
    for range in [0..1, 1..300, 0..150, 150..299, 299..300, 37..91] {
        let part = run(&spec, range.clone());
        let rows = range.start as usize * row..range.end as usize * row;
        assert!(*part.series.u() == whole.series.u()[rows.clone()], "torques of {range:?}");
        assert!(*part.series.y() == whole.series.y()[rows], "positions of {range:?}");
        assert_eq!(part.scenarios, whole.scenarios[range.start as usize..range.end as usize]);
    }
}

#[test]
fn the_number_of_threads_does_not_show() {
    let spec = small("f32");
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| run(&spec, 0..300))
    };
    let one = on(1);
    assert!(on(2) == one);
    assert!(on(5) == one);
}

#[test]
fn precision_changes_positions_a_little_and_torques_not_at_all() {
    let (single, double) = (run(&small("f32"), 0..50), run(&small("f64"), 0..50));
    assert!(single.series.u() == double.series.u());
    assert!(single.series.y() != double.series.y());
    let far = single
        .series
        .y()
        .iter()
        .zip(double.series.y())
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f32::max);
    assert!(far < 2e-5, "{far} rad");
}

#[test]
fn another_seed_gives_other_trajectories() {
    let spec = small("f32");
    let other = SimulateSpec { seed: spec.seed + 1, ..spec.clone() };
    assert!(run(&spec, 0..4).series.u() != run(&other, 0..4).series.u());
}

#[test]
fn the_bytes_of_a_small_dataset_are_pinned() {
    assert_eq!(
        digest(&run(&small("f32"), 0..40)),
        "a3e31d519614f0ff40aff48fb0655baeee89d15516e8307e382738c1967e689b"
    );
    assert_eq!(
        digest(&run(&small("f64"), 0..40)),
        "63ee258c44f7903c1334fcad9dfe1f0b81bc87abd3f58b7fb1c2f80b3233ff49"
    );
}

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicU64, Ordering};

use dynamics::{DynamicsError, Robot, Trajectories, simulate};
use serde_json::json;
use spec::{Family, Integrator, Range, SimulateSpec};

use super::{chirp, failure, mixed, multisine, run, spec};

use crate::JOINTS;

#[test]
fn recorded_torques_are_those_of_the_scenario_and_recorded_positions_begin_at_its_start() {
    let spec = spec(&mixed(), &json!({}));
    let trajectories = run(&spec, 10..40);
    let row = spec.samples as usize * JOINTS;
    for (scenario, (u, q)) in trajectories.scenarios.iter().zip(
        trajectories.series.u().chunks_exact(row).zip(trajectories.series.y().chunks_exact(row)),
    ) {
        for (k, sample) in u.chunks_exact(JOINTS).enumerate() {
            for (expected, &torque) in
                scenario.excitation.torques().unwrap().at(k as f64 / 60.0).iter().zip(sample)
            {
                assert!((f64::from(torque) - expected).abs() < 1e-6 * expected.abs().max(1.0));
            }
        }
        for (start, &q) in scenario.q0.iter().zip(q) {
            assert_eq!(*start as f32, q);
        }
    }
}

#[test]
fn no_sample_comes_closer_to_a_limit_than_the_margin() {
    let spec = spec(&chirp(0.1), &json!({"rejection": {"position_margin_rad": 0.05}}));
    let trajectories = run(&spec, 0..200);
    for sample in trajectories.series.y().chunks_exact(JOINTS) {
        for (&q, limit) in
            sample.iter().zip(spec.robot.description().per_joint(|joint| joint.position_rad))
        {
            let inside = Range::new(limit.min + 0.05, limit.max - 0.05);
            assert!(inside.contains(f64::from(q)), "{q}");
        }
    }
}

#[test]
fn rejected_draws_are_counted_and_leave_the_frequency_alone() {
    let strict = spec(&mixed(), &json!({"rejection": {"position_margin_rad": 1.0}}));
    let free = spec(&mixed(), &json!({"rejection": {"position_margin_rad": null}}));
    let (strict, free) = (run(&strict, 0..300), run(&free, 0..300));
    let redraws =
        strict.scenarios.iter().map(|scenario| u64::from(scenario.draws) - 1).sum::<u64>();
    assert_eq!(strict.rejected, redraws);
    assert!(strict.rejected > 0);
    assert_eq!(free.rejected, 0);
    for (kept, first) in strict.scenarios.iter().zip(&free.scenarios) {
        assert_eq!((kept.family, kept.frequency_hz), (first.family, first.frequency_hz));
        assert_eq!(kept.draws == 1, kept == first);
    }
}

#[test]
fn a_trajectory_whose_every_draw_is_rejected_is_an_error_that_names_it() {
    let spec = spec(
        &multisine(0.45),
        &json!({
            "initial_state": {"center_rad": [0, 0, 0, -0.5, 0, 1.9, 0]},
            "rejection": {"position_margin_rad": 1.0, "max_draws": 3},
        }),
    );
    let error = failure(&spec, 7..8);
    assert!(
        matches!(error, DynamicsError::EveryDrawRejected { index: 7, seed: 3, draws: 3, .. }),
        "{error}"
    );
}

#[test]
fn a_diverging_integration_is_an_error_that_names_the_trajectory() {
    let unlimited = json!({"rejection": {"position_margin_rad": null}});
    // The parser refuses such a spec.
    let spec = SimulateSpec {
        integrator: Integrator::Rk4 { substeps: 1 },
        ..spec(&multisine(0.1), &unlimited)
    };
    let error = failure(&spec, 5..6);
    assert!(matches!(error, DynamicsError::NotFinite { index: 5, seed: 3, .. }), "{error}");
}

#[test]
fn grid_frequencies_come_in_blocks_of_equal_size() {
    let grid = json!({"chirp": {"frequency_hz": {"grid": [0.2, 0.5, 0.9]}}});
    let spec = spec(&grid, &json!({"trajectories": 30, "samples": 20}));
    let trajectories = run(&spec, 0..30);
    for cell in spec.cells() {
        for scenario in
            &trajectories.scenarios[cell.first as usize..(cell.first + cell.count) as usize]
        {
            assert_eq!(
                (scenario.family, scenario.frequency_hz),
                (Family::Chirp, cell.frequency_hz)
            );
        }
    }
}

#[test]
fn two_grids_come_one_after_the_other() {
    let grids = json!({
        "chirp": {"frequency_hz": {"grid": [0.2, 0.5]}},
        "multisine": {"frequency_hz": {"grid": [0.1]}},
    });
    let spec = spec(&grids, &json!({"trajectories": 9, "samples": 20}));
    let found: Vec<_> = run(&spec, 0..9)
        .scenarios
        .iter()
        .map(|scenario| (scenario.family, scenario.frequency_hz))
        .collect();
    let expected = [(Family::Chirp, 0.2), (Family::Chirp, 0.5), (Family::Multisine, 0.1)]
        .map(|cell| [cell; 3]);
    assert_eq!(found, expected.concat());
}

#[test]
fn steps_stay_within_their_levels_and_are_held() {
    let excitation = json!({"steps": {"frequency_hz": {"fixed": 0.5}, "level_nm": [-2, 1]}});
    let trajectories = run(&spec(&excitation, &json!({})), 0..50);
    let series = &trajectories.series;
    let joints = series.joints();
    let mut jumps = 0;
    for torques in series.u().chunks_exact(series.samples() * joints) {
        assert!(torques.iter().all(|torque| (-2.0..=1.0).contains(torque)));
        let steps = torques.chunks(joints).zip(torques.chunks(joints).skip(1));
        jumps += steps.map(|(a, b)| a.iter().zip(b).filter(|(a, b)| a != b).count()).sum::<usize>();
    }
    // Levels are held for 1 s on average, from the first sample on.
    let seconds = series.samples() as f64 / 60.0;
    let of_each = jumps as f64 / (50 * joints) as f64;
    assert!((of_each - (seconds - 0.5)).abs() < 0.5, "{of_each} in {seconds} s");
}

#[test]
fn a_family_more_changes_nothing_of_the_others() {
    let grids = json!({
        "chirp": {"frequency_hz": {"grid": [0.2, 0.5]}},
        "multisine": {"frequency_hz": {"grid": [0.1]}},
    });
    let mut more = grids.clone();
    more["steps"] = json!({"frequency_hz": {"grid": [0.3]}});
    let few = run(&spec(&grids, &json!({"trajectories": 9, "samples": 20})), 0..9);
    let many = run(&spec(&more, &json!({"trajectories": 12, "samples": 20})), 0..12);
    assert_eq!(many.scenarios[..9], few.scenarios[..]);
    assert_eq!(many.series.u()[..few.series.u().len()], *few.series.u());
    // The family changes only torques.
    let robots = |trajectories: &Trajectories| -> Vec<Robot> {
        trajectories.scenarios.iter().map(|scenario| scenario.robot.clone()).collect()
    };
    let steps = json!({"steps": {"frequency_hz": {"fixed": 0.3}}});
    let chirps = json!({"chirp": {"frequency_hz": {"fixed": 0.3}}});
    let loose = json!({"samples": 20, "rejection": {"position_margin_rad": null}});
    assert_eq!(
        robots(&run(&spec(&steps, &loose), 0..5)),
        robots(&run(&spec(&chirps, &loose), 0..5))
    );
}

#[test]
fn families_and_frequencies_are_drawn_in_the_shares_asked_for() {
    let excitation = json!({
        "chirp": {"frequency_hz": {"uniform": [0.2, 0.4]}},
        "multisine": {"frequency_hz": {"uniform": [0.05, 0.15]}},
        "chirp_fraction": 0.25,
    });
    let trajectories = run(&spec(&excitation, &json!({"samples": 2})), 0..4000);
    let chirps: Vec<_> =
        trajectories.scenarios.iter().filter(|scenario| scenario.family == Family::Chirp).collect();
    assert!((chirps.len() as f64 / 4000.0 - 0.25).abs() < 0.03);
    let mean =
        chirps.iter().map(|scenario| scenario.frequency_hz).sum::<f64>() / chirps.len() as f64;
    assert!((mean - 0.3).abs() < 0.01, "{mean}");
}

#[test]
fn progress_counts_up_and_can_cancel() {
    let spec = spec(&multisine(0.1), &json!({}));
    let most = AtomicU64::new(0);
    let count = |done| {
        most.fetch_max(done, Ordering::Relaxed);
        ControlFlow::Continue(())
    };
    simulate(&spec, 0..100, &count).unwrap();
    assert_eq!(most.into_inner(), 100);

    let stop_at_50 =
        |done| if done < 50 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) };
    let result = simulate(&spec, 0..1000, &stop_at_50);
    assert!(matches!(result, Err(DynamicsError::Cancelled { .. })));
}

#[test]
fn an_empty_range_has_no_trajectories() {
    let trajectories = run(&spec(&multisine(0.1), &json!({})), 5..5);
    assert_eq!(
        (trajectories.series.robots(), trajectories.series.u().len(), trajectories.scenarios.len()),
        (0, 0, 0)
    );
}

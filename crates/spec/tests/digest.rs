//! A digest identifies results. It must change with everything that changes them, and with nothing
//! else.

#![expect(clippy::unwrap_used, reason = "a test may panic")]

use proptest::prelude::*;
use serde_json::json;
use spec::{JobSpec, parse};

fn simulate(extra: &serde_json::Value) -> JobSpec {
    let mut base = json!({
        "kind": "simulate",
        "trajectories": 100,
        "excitation": {"multisine": {"frequency_hz": {"fixed": 0.15}}},
    });
    for (key, value) in extra.as_object().unwrap() {
        base[key] = value.clone();
    }
    parse(base.to_string().as_bytes()).unwrap()
}

#[test]
fn defaults_written_out_leave_the_digest_alone() {
    let implicit = simulate(&json!({}));
    let explicit = parse(implicit.to_json().to_string().as_bytes()).unwrap();
    assert_eq!(implicit, explicit);
    assert_eq!(implicit.digest(), explicit.digest());
}

#[test]
fn how_a_job_is_run_leaves_the_digest_alone() {
    for execution in [
        json!({"priority": 7, "max_attempts": 5}),
        json!({"time_limit_s": 60, "not_before": "2026-12-01T08:00:00Z"}),
        json!({"resources": {"cpus": 8, "gpus": 1, "memory_gb": 16, "tags": ["a100"]}}),
    ] {
        let asked = simulate(&json!({"execution": execution}));
        assert_eq!(asked.digest(), simulate(&json!({})).digest());
        let again = parse(asked.to_json().to_string().as_bytes()).unwrap();
        assert_eq!(again, asked, "it is kept");
    }
}

/// Catches a change of meaning or default that would silently reuse old results.
#[test]
fn the_digest_of_a_known_spec_is_pinned() {
    assert_eq!(
        simulate(&json!({})).digest().to_string(),
        "79452e61c4afed08f4fdf80f0bca8f06c12d868c2ebde3e7586b2c24493978ab"
    );
}

/// Options added later do not change the digests of evaluations that do not use them.
#[test]
fn the_digest_of_an_evaluation_is_pinned() {
    let baselines = [
        "hold-last",
        "damped-integrator",
        "fitted-damping",
        "least-squares",
        "arx",
        "identification",
    ];
    let spec = json!({
        "kind": "evaluate", "data": {"digest": "0".repeat(64)}, "baselines": baselines,
    });
    assert_eq!(
        parse(spec.to_string().as_bytes()).unwrap().digest().to_string(),
        "cec17b66cf57e14aafc51b5833610b63d0b754834472945959ff85f1d4d4fb22"
    );
}

/// `constant-velocity` was added later. Presets and the results of earlier versions keep their
/// digests.
#[test]
fn constant_velocity_among_all_baselines_leaves_the_digest_alone() {
    let evaluate = |baselines: Option<&[&str]>| {
        let mut spec = json!({"kind": "evaluate"});
        if let Some(names) = baselines {
            spec["baselines"] = json!(names);
        }
        parse(spec.to_string().as_bytes()).unwrap()
    };
    let before = [
        "hold-last",
        "damped-integrator",
        "fitted-damping",
        "least-squares",
        "arx",
        "nominal-simulator",
        "simulator-fitted-damping",
        "identification",
    ];
    let all = evaluate(None);
    assert_eq!(all.digest(), evaluate(Some(&before)).digest());
    assert_eq!(all.to_json()["baselines"][1], "constant-velocity");
    let two = evaluate(Some(&["hold-last", "constant-velocity"]));
    assert_ne!(two.digest(), evaluate(Some(&["hold-last"])).digest());
}

#[test]
fn horizons_at_their_default_leave_the_digest_alone() {
    let evaluate = |fields: &str| {
        parse(format!(r#"{{"kind": "evaluate"{fields}}}"#).as_bytes()).map(|job| job.digest())
    };
    let usual = evaluate("").unwrap();
    assert_eq!(evaluate(r#", "horizons_s": [0.1, 0.5, 1.33]"#).unwrap(), usual);
    assert_ne!(evaluate(r#", "horizons_s": []"#).unwrap(), usual);
    let refused = evaluate(r#", "horizons_s": [0.1, 0.1004]"#).unwrap_err();
    assert!(refused.to_string().contains("100 ms twice"), "{refused}");
    evaluate(r#", "horizons_s": [0]"#).unwrap_err();
}

#[test]
fn an_evaluation_without_data_is_one_over_both_families() {
    let spec = |extra: &str| parse(format!(r#"{{"kind": "evaluate"{extra}}}"#).as_bytes()).unwrap();
    let JobSpec::Evaluate(evaluate) = spec("") else { panic!("not an evaluation") };
    let spec::DataSource::Stream(stream) = &evaluate.data else { panic!("not a stream") };
    assert_eq!((stream.trajectories, stream.samples), (2100, 400));
    let cells = stream.cells();
    assert_eq!((cells[9].family, cells[9].frequency_hz), (spec::Family::Chirp, 1.0));
    assert_eq!((cells[10].family, cells[10].first), (spec::Family::Multisine, 1000));

    let shifted = spec(r#", "scenarios": 5, "samplers": [{"steps": [1, 5], "start": "shifted"}]"#);
    let JobSpec::Evaluate(shifted) = shifted else { panic!("not an evaluation") };
    let spec::DataSource::Stream(stream) = &shifted.data else { panic!("not a stream") };
    assert_eq!((stream.trajectories, stream.samples), (105, 408));
    assert_eq!((shifted.rounds(), shifted.horizon(408)), (8, 80));
}

proptest! {
    #[test]
    fn another_seed_or_size_is_another_digest(seed in 1_u64..1 << 53, trajectories in 1_u64..100) {
        let reference = simulate(&json!({})).digest();
        prop_assert_ne!(simulate(&json!({"seed": seed})).digest(), reference);
        prop_assert_ne!(simulate(&json!({"trajectories": trajectories})).digest(), reference);
    }

    #[test]
    fn any_bytes_parse_or_fail_without_a_panic(text in "\\PC*") {
        let _ = parse(text.as_bytes());
    }
}

/// Noise was added later. A spec that does not use it means the same as before.
#[test]
fn noise_at_its_default_is_not_part_of_a_spec() {
    let simulate = json!({
        "kind": "simulate", "trajectories": 1, "excitation": {"chirp": {"frequency_hz": {"fixed": 0.5}}}
    });
    let with = |observations: serde_json::Value| {
        let mut spec = simulate.clone();
        spec["observations"] = observations;
        spec::parse(spec.to_string().as_bytes()).unwrap().digest()
    };
    let zeros =
        json!({"position_noise_rad": 0, "position_resolution_rad": 0.0, "torque_noise_nm": 0});
    assert_eq!(with(zeros), with(json!({})));
    assert_ne!(with(json!({"position_noise_rad": 1e-3})), with(json!({})));
    let evaluate = |fields: serde_json::Value| {
        let mut spec = json!({"kind": "evaluate"});
        spec.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
        spec::parse(spec.to_string().as_bytes()).unwrap().digest()
    };
    assert_eq!(evaluate(json!({"position_noise_rad": [0]})), evaluate(json!({})));
    assert_ne!(evaluate(json!({"position_noise_rad": [0, 1e-3]})), evaluate(json!({})));
}

/// An import that was stored before there was a low-pass means none. One that is submitted now
/// states its own.
#[test]
fn stored_imports_keep_their_digest_and_new_ones_state_their_low_pass() {
    let names = |letter: &str| (1..=7).map(|k| format!("{letter}{k}")).collect::<Vec<_>>();
    let import = |fields: &serde_json::Value| {
        let mut import = json!({
            "kind": "import", "file": "0".repeat(64), "format": "csv", "resampling": "linear",
            "columns": {"time": "t", "u": names("u"), "q": names("q")},
        });
        import.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
        import
    };
    let stored: JobSpec = serde_json::from_value(import(&json!({}))).unwrap();
    assert_eq!(stored.to_json().get("low_pass_hz"), None);
    assert_eq!(
        stored.digest().to_string(),
        "83c1d2e371c6eb153455e50e25833a33a54279251ac475c25037a177d8d7086b"
    );
    let submitted = |fields| parse(import(&fields).to_string().as_bytes()).unwrap();
    for (fields, edge) in [
        (json!({}), json!(24.0)),
        (json!({"low_pass_hz": null, "rate_hz": 100}), json!(40.0)),
        (json!({"low_pass_hz": 10}), json!(10.0)),
        (json!({"low_pass_hz": "none"}), json!("none")),
    ] {
        let job = submitted(fields);
        assert_eq!(job.to_json()["low_pass_hz"], edge);
        assert_eq!(parse(job.to_json().to_string().as_bytes()).unwrap(), job);
        assert_ne!(job.digest(), stored.digest());
    }
    let even = submitted(json!({"resampling": "none"}));
    assert_eq!(even.to_json().get("low_pass_hz"), None);
}

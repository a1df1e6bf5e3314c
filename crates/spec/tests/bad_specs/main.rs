//! Errors of specs: each names the field, the value and what is allowed.

#![expect(clippy::unwrap_used, reason = "a test may panic")]

mod pipelines;
mod words;
mod worst;

use serde_json::{Value, json};

fn simulate() -> Value {
    json!({
        "kind": "simulate",
        "trajectories": 100,
        "excitation": {"multisine": {"frequency_hz": {"fixed": 0.15}}},
    })
}

fn train() -> Value {
    json!({
        "kind": "train",
        "data": {"dataset": 1},
        "model": {"preset": "robomorph-tiny"},
        "steps": 100,
    })
}

/// Parses `base` with `value` at the JSON pointer `at`. Returns the error's text.
fn error_of(mut base: Value, at: &str, value: Value) -> String {
    let (parent, field) = at.rsplit_once('/').unwrap();
    base.pointer_mut(parent).unwrap().as_object_mut().unwrap().insert(field.to_owned(), value);
    spec::parse(base.to_string().as_bytes()).unwrap_err().to_string()
}

fn check_refused(base: Value, at: &str, value: Value, expected: &[&str]) {
    let error = error_of(base, at, value);
    for part in expected {
        assert!(error.contains(part), "{error:?} lacks {part:?}");
    }
}

#[test]
fn an_unknown_field_is_named() {
    check_refused(
        simulate(),
        "/robots",
        json!(3),
        &["robots: unknown field", "did you mean `robot`?"],
    );
    check_refused(simulate(), "/robot", json!({"mas": 1}), &["robot.mas", "mass_fraction"]);
    check_refused(train(), "/model/hidden", json!(3), &["model", "hidden"]);
}

#[test]
fn a_number_out_of_range_is_named_with_its_range() {
    check_refused(simulate(), "/trajectories", json!(0), &["trajectories is 0", "1 to 2147483647"]);
    check_refused(simulate(), "/trajectories", json!(-4), &["trajectories", "-4"]);
    check_refused(simulate(), "/trajectories", json!(4_000_000_000_u64), &["1 to 2147483647"]);
    check_refused(simulate(), "/rate_hz", json!("fast"), &["rate_hz", "fast"]);
    check_refused(simulate(), "/seed", json!(u64::MAX), &["seed", "9007199254740991"]);
    check_refused(train(), "/context", json!(321), &["context is 321", "model.patch"]);
    check_refused(train(), "/model/heads", json!(7), &["model.d_model", "a multiple of heads"]);
}

#[test]
fn what_no_worker_could_offer_is_refused() {
    let refused = |execution: Value, expected: &[&str]| {
        check_refused(simulate(), "/execution", execution, expected);
    };
    let resources = |resources: Value| json!({"resources": resources});
    refused(resources(json!({"cpus": 0})), &["execution.resources.cpus is 0", "1 to 1024"]);
    refused(resources(json!({"gpus": 65})), &["execution.resources.gpus is 65", "0 to 64"]);
    refused(
        resources(json!({"memory_gb": 0.05})),
        &["resources.memory_gb is 0.05", "0.1 to 100000"],
    );
    refused(resources(json!({"gpu": 1})), &["execution.resources", "gpu: unknown field", "gpus"]);
    refused(
        resources(json!({"tags": ["A100"]})),
        &["execution.resources.tags is \"A100\"", "lower-case"],
    );
    let many: Vec<String> = (0..17).map(|k| format!("tag-{k}")).collect();
    refused(
        resources(json!({"tags": many})),
        &["execution.resources.tags is 17 tags", "at most 16"],
    );
    let without_zone = json!({"not_before": "2026-12-01T08:00:00"});
    refused(without_zone, &["execution.not_before", "2026-12-01T08:00:00", "with its zone"]);
}

#[test]
fn noise_that_no_sensor_has_is_refused() {
    for (field, value, expected) in [
        ("position_noise_rad", json!(-1e-3), "observations.position_noise_rad is -0.001: 0 to 0.1"),
        ("position_noise_rad", json!(3.0), "observations.position_noise_rad is 3: 0 to 0.1"),
        ("position_resolution_rad", json!(0.2), "position_resolution_rad is 0.2: 0 to 0.1"),
        ("torque_noise_nm", json!(101), "observations.torque_noise_nm is 101: 0 to 100"),
        ("torque_noise_nm", json!(null), "observations.torque_noise_nm"),
    ] {
        let mut base = simulate();
        base["observations"] = json!({});
        let at = format!("/observations/{field}");
        let error = error_of(base, &at, value);
        for part in expected.split(": ") {
            assert!(error.contains(part), "{error:?} lacks {part:?}");
        }
    }
    let evaluate = json!({"kind": "evaluate"});
    for (levels, expected) in [
        (json!([]), "position_noise_rad is 0"),
        (json!([0, -1e-4]), "position_noise_rad[1] is -0.0001"),
        (json!([0.2]), "position_noise_rad[0] is 0.2"),
        (json!([1e-3, 1e-3]), "position_noise_rad is 0.001 twice"),
        (json!(1e-3), "position_noise_rad"),
    ] {
        check_refused(evaluate.clone(), "/position_noise_rad", levels, &[expected]);
    }
}

fn train_a(preset: &str) -> Value {
    let mut base = train();
    base["model"] = json!({"preset": preset});
    base
}

#[test]
fn sizes_that_do_not_divide_are_named_with_both_numbers() {
    let diffuser = || train_a("diffuser-tiny");
    check_refused(diffuser(), "/model/width", json!(20), &["model.width is 20", "multiple", "8"]);
    check_refused(diffuser(), "/model/multipliers", json!([1, 0]), &["model.multipliers[1] is 0"]);
    let cdcnn = || train_a("cdcnn-tiny");
    check_refused(cdcnn(), "/model/widths", json!([16, 20]), &["model.widths[1] is 20", "8"]);
    check_refused(cdcnn(), "/model/embedding", json!(5), &["model.embedding is 5", "2"]);
    check_refused(train_a("cdt-tiny"), "/model/heads", json!(5), &["d_model is 48", "heads", "5"]);
    for field in ["dropout", "embedding_dropout"] {
        for share in [json!(1.0), json!(-0.1)] {
            let path = format!("/model/{field}");
            let named = format!("model.{field} is");
            check_refused(train_a("cdt-tiny"), &path, share, &[&named, "0 to below 1"]);
        }
    }
    check_refused(
        train(),
        "/gradient_accumulation",
        json!(7),
        &["is 7", "batch_size, which is 64"],
    );
}

#[test]
fn a_flow_and_a_diffusion_are_each_sampled_in_their_own_way() {
    let flow = || train_a("flow-tiny");
    check_refused(
        flow(),
        "/model/sampler",
        json!({"kind": "ddim", "steps": 5}),
        &["model.sampler.kind is ddim", "euler, heun of a model that is a flow"],
    );
    check_refused(
        flow(),
        "/model/sampler",
        json!({"kind": "heun", "steps": 1001}),
        &["model.sampler.steps is 1001", "at most a flow's times, which are 1000"],
    );
    check_refused(
        flow(),
        "/model/sampler",
        json!({"kind": "euler", "spacing": "leading"}),
        &["model.sampler.spacing is leading", "trailing"],
    );
    check_refused(flow(), "/model/warm_start_time", json!(0), &["model.warm_start_time is 0"]);
    check_refused(flow(), "/model/widths", json!([12]), &["model.widths[0] is 12", "8"]);
    check_refused(
        train_a("cdcnn-tiny"),
        "/model/sampler",
        json!({"kind": "euler", "steps": 2}),
        &["model.sampler.kind is euler", "ddpm, ddim, dpm-solver++"],
    );
}

#[test]
fn a_sampler_longer_than_the_noise_is_named_with_both_numbers() {
    check_refused(
        train_a("cdt-tiny"),
        "/model/sampler",
        json!({"kind": "ddim", "steps": 101}),
        &["model.sampler.steps is 101", "at most diffusion.steps, which is 100"],
    );
    check_refused(
        train_a("cdt-tiny"),
        "/model/sampler",
        json!({"kind": "ddpm", "eta": 0.5}),
        &["model.sampler.eta is 0.5", "0 unless kind is ddim"],
    );
    check_refused(
        train_a("cdt-tiny"),
        "/model/residual",
        json!("integrated"),
        &["model", r#""none", "integrator", "lagged-integrator""#],
    );
    check_refused(
        train_a("cdt-tiny"),
        "/model/residual",
        json!({"integrator": {"damping": 0}}),
        &["model.residual.integrator.damping is 0"],
    );
    check_refused(train(), "/ema", json!({"decay": 1.0}), &["ema.decay is 1"]);
}

#[test]
fn a_residual_is_named_alone_or_with_its_damping() {
    let parsed = |residual: Value| {
        let mut base = train_a("cdt-tiny");
        base["model"]["residual"] = residual;
        spec::parse(base.to_string().as_bytes()).unwrap().to_json()["model"]["residual"].clone()
    };
    assert_eq!(parsed(json!("integrator")), json!({"integrator": {"damping": 10.0}}));
    assert_eq!(
        parsed(json!({"integrator": {"damping": 7}})),
        json!({"integrator": {"damping": 7.0}})
    );
    assert_eq!(parsed(json!("lagged-integrator")), json!({"lagged-integrator": {"damping": 10.0}}));
    assert_eq!(
        parsed(json!({"lagged-integrator": {"damping": 7}})),
        json!({"lagged-integrator": {"damping": 7.0}})
    );
    assert_eq!(parsed(json!("none")), Value::Null, "the default is not written");
}

#[test]
fn a_frequency_above_nyquist_is_refused() {
    let grid = json!({"multisine": {"frequency_hz": {"grid": [1.0, 20.0]}}});
    check_refused(simulate(), "/excitation", grid, &["frequency_hz", "30 Hz"]);
}

#[test]
fn numbers_that_json_cannot_hold_are_refused() {
    for text in
        [r#"{"kind":"simulate","trajectories":NaN}"#, r#"{"rate_hz":1e999}"#, "", "[]", "nul"]
    {
        assert!(spec::parse(text.as_bytes()).is_err(), "{text}");
    }
}

#[test]
fn an_unknown_preset_or_kind_lists_the_known_ones() {
    check_refused(simulate(), "/preset", json!("D9"), &["preset", "D9", "D1-multisine"]);
    check_refused(simulate(), "/kind", json!("simulat"), &["kind", "simulat", "evaluate"]);
    check_refused(
        train(),
        "/model",
        json!({"preset": "huge"}),
        &["model.preset", "robomorph-tiny"],
    );
}

#[test]
fn a_name_of_a_pipeline_job_means_nothing_outside_one() {
    check_refused(train(), "/data", json!({"job": "train-set"}), &["data", "only in a pipeline"]);
}

#[test]
fn every_violation_is_reported_at_once() {
    let mut base = simulate();
    base["rate_hz"] = json!(0);
    base["samples"] = json!(1);
    let error = spec::parse(base.to_string().as_bytes()).unwrap_err();
    assert_eq!(error.violations.len(), 2 + 1, "rate, samples and Nyquist: {error}");
}

#[test]
fn a_mistake_inside_a_stream_is_named_with_its_whole_path() {
    let stream = |fields: Value| {
        let mut stream = json!({"preset": "D1-chirp"});
        stream.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
        json!({"stream": stream})
    };
    let refused = |fields, expected: &[&str]| {
        check_refused(train(), "/data", stream(fields), expected);
    };
    refused(json!({"rate_hz": 0}), &["data.stream.rate_hz is 0", "1 to 1000"]);
    refused(json!({"preset": "D9"}), &["data.stream.preset", "D9", "D1-chirp"]);
    refused(json!({"kind": "train"}), &["data.stream.kind", "simulate"]);
    refused(json!({"execution": {"priority": 3}}), &["data.stream.execution"]);
    let grid = json!({"preset": "grid-chirp"});
    check_refused(train(), "/data", json!({"stream": grid}), &["data.stream.excitation", "grid"]);
}

#[test]
fn a_stream_for_training_need_not_end_and_one_for_evaluation_must() {
    let endless = json!({"stream": {"excitation": {"chirp": {"frequency_hz": {"fixed": 0.2}}}}});
    let mut spec = train();
    spec["data"] = endless.clone();
    spec::parse(spec.to_string().as_bytes()).unwrap();
    let evaluate = json!({"kind": "evaluate"});
    check_refused(
        evaluate,
        "/data",
        endless,
        &["data.stream", "data.stream.trajectories is missing"],
    );
}

#[test]
fn a_training_without_checkpoints_or_with_an_early_stop_but_no_validation_is_refused() {
    let mut never = train();
    never["checkpoint_every_seconds"] = json!(null);
    let expected = ["checkpoint_every_steps is null", "checkpoint_every_seconds"];
    check_refused(never, "/checkpoint_every_steps", json!(null), &expected);
    check_refused(train(), "/checkpoint_every_seconds", json!(0), &["1 to 1000000"]);
    check_refused(train(), "/keep_checkpoints", json!(0), &["keep_checkpoints is 0", "1 to 1000"]);

    let mut blind = train();
    blind["validation_fraction"] = json!(0);
    check_refused(blind, "/early_stop", json!({}), &["validation_fraction is 0", "early_stop"]);
    let impatient = json!({"patience": 0});
    check_refused(train(), "/early_stop", impatient, &["early_stop.patience is 0"]);
    let negative = json!({"min_delta": -0.1});
    check_refused(train(), "/early_stop", negative, &["early_stop.min_delta is -0.1"]);
    check_refused(train(), "/monitor", json!("train/loss"), &["monitor", "validation/rmse_deg"]);
}

#[test]
fn what_is_given_fits_the_model_its_path_and_the_baselines() {
    let references = json!("references");
    let mut physical = train();
    physical["model"] = json!({"preset": "lagrangian-tiny"});
    let expected = ["given is references", "torques for a lagrangian"];
    check_refused(physical, "/given", references.clone(), &expected);
    let integrated = ["model.residual is lagged-integrator", "reference or none"];
    check_refused(train(), "/given", references, &integrated);
    let reference = json!({"preset": "robomorph-tiny", "residual": "reference"});
    check_refused(train(), "/model", reference, &["model.residual is reference", "torques give"]);
    check_refused(train(), "/given", json!("positions"), &["given", "torques", "references"]);
    let evaluate = json!({"kind": "evaluate", "data": {"dataset": 1}, "given": "references"});
    let wrong = json!(["hold-last", "identification"]);
    let expected = ["baselines[1] is \"identification\"", "answers with references"];
    check_refused(evaluate, "/baselines", wrong, &expected);
    let of_torques = json!({"kind": "evaluate", "data": {"dataset": 1}});
    check_refused(of_torques, "/baselines", json!(["follow-reference"]), &["answers with torques"]);
}

#[test]
fn what_a_fine_tuning_keeps_is_a_part_of_its_model() {
    let mut tuned = train();
    tuned["init"] = json!({"checkpoint": 7});
    let wrong = json!(["decoder_blocks.1", "decoder"]);
    check_refused(
        tuned.clone(),
        "/frozen",
        wrong,
        &["frozen[1] is \"decoder\"", "a part of robomorph", "encoder_blocks, encoder_norm"],
    );
    check_refused(tuned.clone(), "/frozen", json!(["head", "head"]), &["frozen", "twice"]);
    check_refused(tuned.clone(), "/frozen", json!([""]), &["frozen[0]", "1 to 200"]);
    check_refused(train(), "/frozen", json!(["head"]), &["frozen", "left out without init"]);
    check_refused(tuned, "/init", json!({"checkpoints": 7}), &["init is", "{\"checkpoint\": ...}"]);
    check_refused(train(), "/init", json!(7), &["init is 7"]);
}

#[test]
fn sources_of_a_training_have_weights_and_trajectories_in_every_batch() {
    let two = json!([{"dataset": 1}, {"dataset": 2}]);
    let mixed = || {
        let mut mixed = train();
        mixed["data"] = two.clone();
        mixed
    };
    check_refused(mixed(), "/data_weights", json!([1]), &["data_weights is 1 numbers", "are 2"]);
    check_refused(mixed(), "/data_weights", json!([1, 0]), &["data_weights[1] is 0"]);
    let none = ["data_weights[1] is 0.001 of 1.001", "data[1]", "batch_size than 64"];
    check_refused(mixed(), "/data_weights", json!([1, 0.001]), &none);
    check_refused(mixed(), "/batch_size", json!(1), &["batch_size is 1", "data[1]"]);
    check_refused(train(), "/data", json!([]), &["data is 0", "1 to 16"]);
    check_refused(train(), "/data", json!([{"dataset": 1}, {"dataset": 1}]), &["twice"]);
    let grid = json!([{"dataset": 1}, {"stream": {"preset": "grid-chirp"}}]);
    check_refused(train(), "/data", grid, &["data[1].stream.excitation is a frequency grid"]);
    let unknown = json!([{"dataset": 1}, {"stream": {"preset": "D1-chrip"}}]);
    check_refused(train(), "/data", unknown, &["data[1].stream.preset", "D1-chirp"]);
    let named = json!([{"dataset": 1}, "D1-chirp"]);
    check_refused(train(), "/data", named, &["data[1]", "did you mean {\"stream\""]);
}

#[test]
fn loss_weights_are_not_negative_and_one_counts() {
    let negative = json!([1, 1, 1, -1, 1, 1, 1]);
    check_refused(train(), "/loss_weights", negative, &["loss_weights[3] is -1", "0 to 1000000"]);
    check_refused(train(), "/loss_weights", json!([0, 0, 0, 0, 0, 0, 0]), &["one above 0"]);
}

#[test]
fn an_import_that_uses_a_column_twice_or_in_wrong_units_is_refused() {
    let import = || {
        json!({
            "kind": "import",
            "file": "0".repeat(64),
            "format": "csv",
            "columns": {
                "u": ["u1", "u2", "u3", "u4", "u5", "u6", "u7"],
                "q": ["q1", "q2", "q3", "q4", "q5", "q6", "q7"],
            },
        })
    };
    spec::parse(import().to_string().as_bytes()).unwrap();
    let twice = json!(["q1", "q2", "q3", "q4", "q5", "q6", "u1"]);
    check_refused(import(), "/columns/q", twice, &["columns.q[6]", "u1", "u[0]"]);
    check_refused(import(), "/units", json!({"angle": "turns"}), &["units.angle", "deg"]);
    check_refused(import(), "/resampling", json!("linear"), &["columns.time", "resampling"]);
    let expected = ["position_noise_rad is 0.2", "0 to 0.1"];
    check_refused(import(), "/position_noise_rad", json!(0.2), &expected);
    check_refused(import(), "/split", json!({"kind": "windows", "stride": 0}), &["split.stride"]);
    let windows = "\"split\": {\"kind\": \"windows\", \"stride\": 10000} cuts a longer recording";
    let expected = ["samples is 150000, allowed: 2 to 10000; ", windows];
    check_refused(import(), "/samples", json!(150_000), &expected);

    let one = json!([1, 1, 1, 1, 1, 1]);
    check_refused(import(), "/columns/gains", one, &["columns.gains is 6 numbers", "7 numbers"]);
    let none = json!([1, 1, 0, 1, 1, 1, 1]);
    check_refused(import(), "/columns/gains", none, &["columns.gains[2] is 0", "not 0"]);
    check_refused(import(), "/csv", json!({"separator": "5"}), &["csv.separator is '5'", "ASCII"]);
    check_refused(
        import(),
        "/csv",
        json!({"decimal_comma": true}),
        &["csv.decimal_comma", "comma"],
    );
    let topic = json!({"topic": "/joint_states"});
    check_refused(
        import(),
        "/mcap",
        topic,
        &["mcap is given with csv", "only with the format mcap"],
    );
    check_refused(import(), "/low_pass_hz", json!(20), &["low_pass_hz is 20", "resampling"]);
    let linear = || {
        let mut import = import();
        import["resampling"] = json!("linear");
        import["columns"]["time"] = json!("t");
        import
    };
    for edge in [30, 2] {
        let expected = [&format!("low_pass_hz is {edge}")[..], "3 to below 30"];
        check_refused(linear(), "/low_pass_hz", json!(edge), &expected);
    }
    let mut lists = linear();
    lists["format"] = json!("parquet");
    lists["columns"]["q"] = json!(["observation.state"]);
    spec::parse(lists.to_string().as_bytes()).unwrap();
    let csv = json!(["observation.state"]);
    check_refused(linear(), "/columns/q", csv, &["columns.q is 1 column,", "7 columns"]);
}

#[test]
fn a_stream_cannot_be_verified() {
    let verify = json!({"kind": "verify"});
    let stream = json!({"stream": {"preset": "D1-chirp"}});
    check_refused(verify, "/data", stream, &["data", "stream", "dataset"]);
}

#[test]
fn an_impossible_payload_or_friction_is_refused() {
    let heavy = json!({"payload": {"mass_kg": [1.0, 80.0]}});
    check_refused(simulate(), "/robot", heavy, &["robot.payload.mass_kg[1] is 80"]);
    let reversed = json!({"payload": {"mass_kg": [2.0, 1.0]}});
    check_refused(simulate(), "/robot", reversed, &["robot.payload.mass_kg", "min"]);
    let negative = json!({"friction": {"phi1_nm": [-1, 0, 0, 0, 0, 0, 0]}});
    check_refused(simulate(), "/robot", negative, &["robot.friction.phi1_nm[0] is -1"]);
}

fn evaluate() -> Value {
    json!({"kind": "evaluate", "data": {"dataset": 1}})
}

#[test]
fn an_evaluation_out_of_range_is_refused() {
    check_refused(evaluate(), "/samples", json!(0), &["samples is 0", "1 to 256"]);
    check_refused(evaluate(), "/samples", json!(257), &["samples is 257", "1 to 256"]);
    check_refused(evaluate(), "/scenarios", json!(0), &["scenarios is 0", "1 to 10000"]);
    check_refused(evaluate(), "/latency", json!({"repeats": 1}), &["latency.repeats is 1", "20"]);
    let falling = json!([{"steps": [5, 1]}]);
    check_refused(evaluate(), "/samplers", falling, &["samplers[0].steps", "rising order"]);
    let unknown = json!([{"steps": 5, "start": "warm"}]);
    check_refused(evaluate(), "/samplers", unknown, &["samplers[0].start", "oracle"]);
    let mut shifted = evaluate();
    shifted["samplers"] = json!([{"start": "shifted"}]);
    check_refused(shifted, "/rounds", json!(0), &["rounds is 0", "starts cold"]);
    let mut beyond = evaluate();
    beyond["data"] = json!({"stream": {"preset": "grid-multisine", "trajectories": 1}});
    let grid = json!({"multisine": {"frequency_hz": {"grid": [7.0]}}});
    let expected = ["data.stream.excitation.multisine", "31.5 Hz", "30 Hz, half of rate_hz"];
    check_refused(beyond, "/data/stream/excitation", grid, &expected);
}

#[test]
fn of_several_families_all_have_a_grid_or_none() {
    let excitation = json!({
        "chirp": {"frequency_hz": {"grid": [0.1, 0.2]}},
        "multisine": {"frequency_hz": {"fixed": 0.15}},
    });
    check_refused(simulate(), "/excitation", excitation, &["excitation.chirp", "all have one"]);
    let excitation = json!({
        "chirp": {"frequency_hz": {"fixed": 0.1}}, "steps": {"frequency_hz": {"fixed": 0.1}},
    });
    check_refused(simulate(), "/excitation", excitation, &["excitation.steps", "no other family"]);
    let brief = json!({"steps": {"frequency_hz": {"fixed": 20}}});
    check_refused(simulate(), "/excitation", brief, &["excitation.steps.hold_periods", "0.0125 s"]);
}

fn control() -> Value {
    json!({"kind": "control", "data": {"dataset": 1}})
}

#[test]
fn a_path_that_is_none_is_refused() {
    let point = json!({"point-to-point": {"displacement_rad": [0, 0, -0.1], "duration_s": 1}});
    check_refused(control(), "/path", point, &["displacement_rad[2] is -0.1", "0 to 100"]);
    check_refused(control(), "/path", json!({"circle": {}}), &["path", "circle", "swing"]);
}

#[test]
fn a_planner_that_cannot_plan_is_refused() {
    let expected = ["planner.replan_every is 31", "1 to 30", "planner.samples is 1", "2 to 1024"];
    check_refused(control(), "/planner", json!({"replan_every": 31, "samples": 1}), &expected);
    check_refused(control(), "/baselines", json!(["oracle", "oracle"]), &["\"oracle\" twice"]);
    let twice = json!([{"checkpoint": 6}, {"checkpoint": 6}]);
    let expected = "checkpoints is {\"checkpoint\":6} twice, allowed: each once";
    check_refused(control(), "/checkpoints", twice, &[expected]);
    check_refused(control(), "/robots", json!(0), &["robots is 0", "1 to 100"]);
}

fn violations_of(spec: &Value) -> Vec<String> {
    let error = spec::parse(spec.to_string().as_bytes()).unwrap_err();
    error.violations.iter().map(ToString::to_string).collect()
}

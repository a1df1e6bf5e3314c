//! All violations of a spec at once, in words that its author knows.

use serde_json::json;

use super::{check_refused, error_of, simulate, train, violations_of};

#[test]
fn typing_errors_and_wrong_types_are_reported_with_numbers_out_of_range() {
    let mut wrong = simulate();
    wrong["sampels"] = json!(400);
    wrong["rate_hz"] = json!("fast");
    wrong["robot"] = json!({"mass_fraction": 2.0, "gravity": "onn"});
    wrong["excitation"]["multisine"]["base"] = json!([1.0]);
    wrong["initial_state"] = json!(3);
    let found = violations_of(&wrong);
    for expected in [
        "sampels: unknown field; did you mean `samples`?",
        "rate_hz is \"fast\", allowed: a number from 1 to 1000",
        "robot.mass_fraction is 2.0, allowed: 0 to 0.9",
        "robot.gravity is \"onn\", allowed: off, on, compensated; did you mean `on`?",
        "excitation.multisine.base is [1.0], allowed: [min, max], each a number from 0.01 to 100",
    ] {
        assert!(found.iter().any(|message| message == expected), "{found:#?} lacks {expected:?}");
    }
    assert!(
        found
            .iter()
            .any(|message| message.starts_with("initial_state is 3, allowed: an object with"))
    );
    assert_eq!(found.len(), 6, "{found:#?}");
}

#[test]
fn a_field_that_belongs_into_an_object_is_told_its_path() {
    for (field, path) in [
        ("learning_rate", "optimizer.learning_rate"),
        ("lr", "optimizer.learning_rate"),
        ("betas", "optimizer.betas"),
    ] {
        let expected = format!("{field}: unknown field; did you mean `{path}`?");
        assert_eq!(error_of(train(), &format!("/{field}"), json!(1)), expected);
    }
    let mut pipeline = json!({"kind": "pipeline", "name": "p", "jobs": {"train": train()}});
    pipeline["jobs"]["train"]["learning_rate"] = json!(1e-3);
    let expected =
        "jobs.train.learning_rate: unknown field; did you mean `optimizer.learning_rate`?";
    assert_eq!(violations_of(&pipeline), [expected]);
    check_refused(simulate(), "/mass_fraction", json!(0.1), &["`robot.mass_fraction`"]);
}

#[test]
fn a_label_in_a_spec_is_told_the_parameter_that_takes_it() {
    for spec in [train(), simulate()] {
        check_refused(spec.clone(), "/name", json!("a"), &["`?name=...` or `--name ...`"]);
        check_refused(spec, "/tags", json!(["a"]), &["`?tag=...` or `--tag ...`"]);
    }
}

#[test]
fn two_numbers_that_are_no_interval_are_not_called_one() {
    let each = "each a number from 0 to 0.999999";
    let expected = format!("optimizer.betas is [0.9], allowed: a list of 2, {each}");
    assert_eq!(error_of(train(), "/optimizer", json!({"betas": [0.9]})), expected);
}

#[test]
fn a_preset_at_the_wrong_place_is_told_where_it_belongs() {
    let found = violations_of(&json!({"preset": "robomorph-tiny"}));
    assert!(
        found[0].contains("belongs in a train job") && found[0].contains("\"model\""),
        "{found:?}"
    );
    check_refused(
        train(),
        "/model",
        json!({"preset": "D1-chirp"}),
        &["a job (simulate)", "top of a spec"],
    );
}

#[test]
fn no_error_has_the_words_of_the_library_that_reads_json() {
    for (at, value) in [
        ("/precision", json!("f16")),
        ("/precision", json!({"f32": 1})),
        ("/integrator", json!({"scheme": "rk4", "order": 2})),
        ("/integrator", json!("rk4")),
        ("/excitation", json!({"chirp": {"frequency_hz": {"fixed": 0.1, "grid": [1]}}})),
        ("/excitation", json!({"chirp": {"frequency_hz": 0.1}})),
        ("/execution", json!({"not_before": "tomorrow"})),
        ("/samples", json!(2.5)),
        ("/samples", json!(-1)),
        ("/samples", json!(1e30)),
        ("/seed", json!(-1)),
        ("/robot", json!({"payload": {"center_m": [[0, 0]]}})),
        ("/robot", json!({"model": {"name": 1}})),
        ("/kind", json!(1)),
    ] {
        let error = error_of(simulate(), at, value);
        for word in
            ["invalid", "expected", "variant", "sequence", "a map", "u32", "struct", "newtype"]
        {
            assert!(!error.contains(word), "{at}: {error:?} has {word:?}");
        }
    }
}

#[test]
fn the_name_of_a_preset_in_place_of_an_object_is_answered_with_the_preset() {
    let meant = |name: &str| format!("an object; did you mean {{\"preset\": \"{name}\"}}?");
    let model = |value: &str| {
        let mut spec = train();
        spec["model"] = json!(value);
        violations_of(&spec)
    };
    let expected = format!("model is \"lagrangian-tiny\", allowed: {}", meant("lagrangian-tiny"));
    assert_eq!(model("lagrangian-tiny"), [expected]);
    assert!(model("lagrangian-tyni")[0].ends_with(&meant("lagrangian-tiny")));
    let strange = model("perceptron");
    assert!(strange[0].contains("{\"preset\": NAME} with one of robomorph-tiny"), "{strange:?}");

    let mut stream = train();
    stream["data"] = json!({"stream": "D1-chirp"});
    let expected = format!("data.stream is \"D1-chirp\", allowed: {}", meant("D1-chirp"));
    assert_eq!(violations_of(&stream), [expected]);
    stream["data"] = json!("D1-chirp");
    let expected = "did you mean {\"stream\": {\"preset\": \"D1-chirp\"}}?";
    assert!(violations_of(&stream)[0].ends_with(expected), "{:?}", violations_of(&stream));

    assert_eq!(
        violations_of(&json!("quickstart")),
        [format!("the spec is \"quickstart\", allowed: {}", meant("quickstart"))]
    );
    let jobs = json!({"data": "D1-chirp", "train": train()});
    let pipeline = json!({"kind": "pipeline", "name": "p", "jobs": jobs});
    let expected = format!("jobs.data is \"D1-chirp\", allowed: {}", meant("D1-chirp"));
    assert_eq!(violations_of(&pipeline), [expected]);
    let quickstart = json!({"preset": "quickstart", "jobs": {"train": {"model": "flow-tiny"}}});
    let found = violations_of(&quickstart);
    assert!(found[0].starts_with("jobs.train.model is \"flow-tiny\""), "{found:?}");
    assert!(found[0].ends_with(&meant("flow-tiny")), "{found:?}");
}

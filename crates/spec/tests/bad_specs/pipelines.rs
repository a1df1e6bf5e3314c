//! Errors of pipelines name the member.

use serde_json::{Value, json};

use super::{check_refused, simulate, train, violations_of};

/// `data` accepts every job that makes trajectories, and no other.
#[test]
fn a_member_reads_from_members_that_make_what_it_asks_for() {
    let file = "0".repeat(64);
    let joints = |name: &str| (1..=7).map(|joint| format!("{name}{joint}")).collect::<Vec<_>>();
    let recordings = json!({
        "kind": "import", "file": file, "format": "csv",
        "columns": {"u": joints("u"), "q": joints("q")},
    });
    let jobs = json!({
        "recordings": recordings,
        "checked": {"kind": "verify", "data": {"job": "recordings"}},
    });
    let pipeline = json!({"kind": "pipeline", "name": "p", "jobs": jobs});
    spec::parse(pipeline.to_string().as_bytes()).unwrap();

    let again = json!({"kind": "verify", "data": {"job": "checked"}});
    let expected = ["jobs.again.data.job", "a simulate or import job of this pipeline: recordings"];
    check_refused(pipeline, "/jobs/again", again, &expected);
}

#[test]
fn a_pipeline_names_the_member_that_is_wrong() {
    let pipeline = |jobs: Value| json!({"kind": "pipeline", "name": "p", "jobs": jobs});
    let mut lost = train();
    lost["data"] = json!({"job": "nowhere"});
    check_refused(pipeline(json!({"a": simulate()})), "/jobs/b", lost, &["jobs.b.data", "nowhere"]);

    let mut wrong = simulate();
    wrong["samples"] = json!(1);
    check_refused(pipeline(json!({})), "/jobs/a", wrong, &["jobs.a.samples is 1"]);

    let mut circular = simulate();
    circular["needs"] = json!(["a"]);
    check_refused(pipeline(json!({})), "/jobs/a", circular, &["circle"]);

    check_refused(pipeline(json!({})), "/jobs/A b", simulate(), &["A b", "lower-case"]);
}

#[test]
fn all_members_of_a_pipeline_are_looked_at() {
    let mut typed = simulate();
    typed["samples"] = json!("many");
    let mut ranged = simulate();
    ranged["samples"] = json!(1);
    let mut modelled = train();
    modelled["data"] = json!({"job": "a"});
    modelled["model"] = json!({"preset": "robomorf-tiny"});
    modelled["stesp"] = json!(3);
    modelled["needs"] = json!("a");
    let jobs = json!({"a": typed, "b": ranged, "c": modelled});
    let found = violations_of(&json!({"kind": "pipeline", "nam": "p", "jobs": jobs}));
    for expected in [
        "nam: unknown field; did you mean `name`?",
        "name is missing, allowed: a text",
        "jobs.a.samples is \"many\", allowed: a whole number from 2 to 10000",
        "jobs.b.samples is 1, allowed: 2 to 10000",
        "jobs.c.needs is \"a\", allowed: a list of names of jobs",
        "jobs.c.stesp: unknown field; did you mean `steps`?",
    ] {
        assert!(found.iter().any(|message| message == expected), "{found:#?} lacks {expected:?}");
    }
    let model = found.iter().find(|message| message.starts_with("jobs.c.model.preset")).unwrap();
    assert!(model.ends_with("did you mean `robomorph-tiny`?"), "{model}");
}

#[test]
fn a_job_that_a_preset_does_not_have_is_answered_with_the_one_that_was_meant() {
    let found = violations_of(&json!({"preset": "quickstart", "jobs": {"trian": {"steps": 10}}}));
    assert_eq!(
        found,
        ["jobs.trian is {\"steps\":10}, allowed: a job with its kind; did you mean `train`?"]
    );
}

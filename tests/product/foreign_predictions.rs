//! The predictions of a model that torqued does not know, from a file, scored beside the others.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use tempfile::TempDir;

use crate::product::{Product, member, run_to_end, torqued};

const CONTEXT: usize = 40;
const SAMPLES: usize = 60;
/// Trajectories of two cells, 6 each.
const SCENARIOS: usize = 12;

/// A server with a dataset, and its trajectories.
struct Laboratory {
    product: Product,
    folder: TempDir,
    trajectories: Vec<Trajectory>,
}

/// Torques and positions, `[step][joint]`.
struct Trajectory {
    u: Vec<Vec<f64>>,
    q: Vec<Vec<f64>>,
}

/// One recording of a file: its name, the trajectory whose torques it has, and the positions of each step.
type Recording<'a> = (String, &'a Trajectory, Vec<Vec<f64>>);

impl Trajectory {
    fn new(columns: &Value) -> Self {
        let steps = |quantity: &str| -> Vec<Vec<f64>> {
            let value =
                |joint: usize, step: usize| columns[format!("{quantity}{joint}")][step].as_f64();
            let row = |step: usize| (1..=7).map(|joint| value(joint, step).unwrap()).collect();
            (0..SAMPLES).map(row).collect()
        };
        Self { u: steps("u"), q: steps("q") }
    }
}

impl Laboratory {
    async fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let product = Product::start(&folder.path().join("data"));
        let id = product
            .submit(&json!({
                "kind": "simulate", "trajectories": SCENARIOS, "samples": SAMPLES,
                "excitation": {"multisine": {"frequency_hz": {"grid": [0.15, 0.3]}}},
            }))
            .await;
        product.succeeded(id).await;
        let mut trajectories = Vec::new();
        for index in 0..SCENARIOS {
            let found = product.get(&format!("/v1/datasets/1/trajectories/{index}")).await;
            trajectories.push(Trajectory::new(&found["columns"]));
        }
        Self { product, folder, trajectories }
    }

    /// A recording for each trajectory, with what `predict` says of it.
    fn each(&self, predict: impl Fn(&Trajectory) -> Vec<Vec<f64>>) -> Vec<Recording<'_>> {
        let all = self.trajectories.iter().enumerate();
        all.map(|(k, trajectory)| (k.to_string(), trajectory, predict(trajectory))).collect()
    }

    fn write(&self, name: &str, recordings: &[Recording<'_>]) -> PathBuf {
        self.write_from(name, recordings, CONTEXT)
    }

    /// Writes torques from step `first` on beside the positions.
    fn write_from(&self, name: &str, recordings: &[Recording<'_>], first: usize) -> PathBuf {
        let header =
            |quantity: &str| (1..=7).map(|k| format!(",{quantity}{k}")).collect::<String>();
        let mut text = format!("trajectory{}{}\n", header("u"), header("q"));
        for (recording, trajectory, positions) in recordings {
            for (step, q) in positions.iter().enumerate() {
                text += recording;
                for value in trajectory.u[first + step].iter().chain(q) {
                    write!(text, ",{value}").unwrap();
                }
                text.push('\n');
            }
        }
        let path = self.folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    }

    fn import_with(&self, file: &Path, more: &[&str]) -> (Option<i32>, String) {
        let file = file.to_str().unwrap();
        let arguments = ["import", file, "--wait", "--server", &self.product.url];
        let (code, output, errors) = run_to_end(torqued(&arguments).args(more));
        (code, output + &errors)
    }

    /// The dataset that an import of `recordings` makes.
    async fn imported(&self, name: &str, recordings: &[Recording<'_>]) -> i64 {
        let path = self.write(name, recordings);
        self.imported_file(&path).await
    }

    async fn imported_file(&self, path: &Path) -> i64 {
        let (code, output) = self.import_with(path, &["--predictions-of", "1", "--context", "40"]);
        assert_eq!(code, Some(0), "{output}");
        self.product.get("/v1/datasets").await["datasets"][0]["id"].as_i64().unwrap()
    }

    async fn evaluated(&self, predictions: &Value, more: &Value) -> Value {
        let job = self.product.submit(&evaluation(predictions, more)).await;
        self.product.succeeded(job).await;
        self.product.get(&format!("/v1/evaluations/{job}")).await["report"].clone()
    }

    /// The reasons that the server gives at once.
    async fn refusal(&self, predictions: &Value, more: &Value) -> String {
        let (status, problem) =
            self.product.post("/v1/jobs", evaluation(predictions, more).to_string()).await;
        assert_eq!(status.as_u16(), 422, "{problem}");
        problem.to_string()
    }

    /// The reason why an evaluation fails that looks into `dataset`.
    async fn failure(&self, dataset: i64, more: &Value) -> String {
        let spec = evaluation(&json!([named("mine", dataset)]), more);
        let job = self.product.submit(&spec).await;
        let job = self.product.finished(job).await;
        assert_eq!(job["state"], "failed", "{job:#}");
        job["error"].as_str().unwrap().to_owned()
    }
}

fn named(name: &str, dataset: i64) -> Value {
    json!({"name": name, "data": {"dataset": dataset}})
}

fn evaluation(predictions: &Value, more: &Value) -> Value {
    let mut spec = json!({
        "kind": "evaluate", "data": {"dataset": 1}, "context": CONTEXT, "predictions": predictions,
        "baselines": ["hold-last", "damped-integrator"], "bootstrap": {"resamples": 100},
    });
    for (field, value) in more.as_object().unwrap() {
        spec[field] = value.clone();
    }
    spec
}

fn truth(trajectory: &Trajectory) -> Vec<Vec<f64>> {
    trajectory.q[CONTEXT..].to_vec()
}

fn held(trajectory: &Trajectory) -> Vec<Vec<f64>> {
    vec![trajectory.q[CONTEXT - 1].clone(); SAMPLES - CONTEXT]
}

/// The scores of a predictor in each cell and group of a report, without its name.
fn findings(report: &Value, predictor: &str) -> Vec<Value> {
    let mut found = Vec::new();
    for place in
        report["cells"].as_array().unwrap().iter().chain(report["groups"].as_array().unwrap())
    {
        for list in ["rmse_deg", "scores", "rollouts"] {
            let of_predictor = |row: &&Value| row["predictor"] == predictor;
            let mut one =
                place[list].as_array().unwrap().iter().find(of_predictor).unwrap().clone();
            let fields = one.as_object_mut().unwrap();
            fields.remove("predictor");
            // A file says positions alone, and `hold-last` a torque too.
            fields.remove("torque_rmse_nm");
            found.push(one);
        }
    }
    found
}

#[tokio::test]
async fn a_file_is_scored_as_if_its_model_had_been_asked() {
    let laboratory = Laboratory::new().await;
    let oracle = laboratory.imported("truth.csv", &laboratory.each(truth)).await;
    // In another order than the trajectories.
    let mut backwards = laboratory.each(held);
    backwards.reverse();
    let same = laboratory.imported("held.csv", &backwards).await;
    let predictions = json!([named("truth", oracle), named("my-hold", same)]);
    let report = laboratory.evaluated(&predictions, &json!({})).await;
    assert_eq!(report["failures"], json!([]));
    for cell in report["cells"].as_array().unwrap() {
        assert_eq!(cell["rmse_deg"][2]["predictor"], "truth");
        assert_eq!(cell["rmse_deg"][2]["mean"], 0.0);
    }
    assert_eq!(findings(&report, "my-hold"), findings(&report, "hold-last"));

    let infos = report["predictors"].as_array().unwrap();
    let names: Vec<&str> = infos.iter().map(|info| info["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["hold-last", "damped-integrator", "truth", "my-hold"]);
    assert_eq!(infos[2]["kind"], "predictions");
    assert_eq!(infos[2]["told"], "unknown, perhaps the horizon");
    let import = laboratory.product.get(&format!("/v1/datasets/{oracle}")).await;
    assert_eq!(
        (&infos[2]["file"], &infos[2]["digest"]),
        (&import["spec"]["file"], &import["digest"])
    );
    let paired = report["paired"].as_array().unwrap();
    assert!(paired.iter().any(
        |difference| difference["predictor"] == "truth" && difference["against"] == "hold-last"
    ));

    let evaluation = &laboratory.product.get("/v1/evaluations").await["evaluations"][0]["id"];
    let page = laboratory.product.get(&format!("/evaluations/{evaluation}")).await;
    let remark = format!("; file {}", &infos[2]["file"].as_str().unwrap()[..12]);
    assert!(page.as_str().unwrap().contains(&remark), "{remark}");
    // The best model is the file, and it is drawn like a checkpoint.
    assert!(page.as_str().unwrap().contains("prediction-worst.svg"));

    // Without baselines and checkpoints, and a part of the scenarios.
    let few = json!({"baselines": [], "scenarios": 2});
    let report = laboratory.evaluated(&predictions, &few).await;
    assert_eq!(report["groups"][0]["scenarios"], 4);

    let path = format!("/v1/datasets/{oracle}/dependents");
    let dependents = laboratory.product.get(&path).await.to_string();
    assert!(dependents.contains(&evaluation.to_string()), "{dependents}");
}

#[tokio::test]
async fn several_samples_are_scored_as_a_distribution() {
    let laboratory = Laboratory::new().await;
    let spread = |offset: f64| {
        move |trajectory: &Trajectory| -> Vec<Vec<f64>> {
            let moved = |q: Vec<f64>| q.into_iter().map(|q| q + offset).collect();
            truth(trajectory).into_iter().map(moved).collect()
        }
    };
    let mut recordings = laboratory.each(truth);
    for (k, offset) in [-0.01, 0.0, 0.01].into_iter().enumerate() {
        let sample = laboratory.each(spread(offset)).into_iter();
        recordings.extend(sample.map(|(name, u, q)| (format!("{name}/{k}"), u, q)));
    }
    let dataset = laboratory.imported("samples.csv", &recordings).await;
    let predictions = json!([named("ensemble", dataset)]);
    let report = laboratory.evaluated(&predictions, &json!({"samples": 3})).await;
    let scores = report["groups"][0]["scores"].as_array().unwrap();
    let scores = scores.iter().find(|scores| scores["predictor"] == "ensemble").unwrap();
    // Samples at -a, 0 and a around the truth: E|x - y| = 2a/3, and half of E|x - x'| of pairs is the same.
    assert!(scores["crps_deg"]["mean"].as_f64().unwrap().abs() < 1e-4, "{scores:#}");
    let rmse = report["groups"][0]["rmse_deg"].as_array().unwrap();
    assert_eq!(rmse.iter().find(|rmse| rmse["predictor"] == "ensemble").unwrap()["mean"], 0.0);

    let failure = laboratory.failure(dataset, &json!({"samples": 4})).await;
    assert!(failure.contains("predictions[0].data is 3 samples of trajectory 0"), "{failure}");
    assert!(failure.contains("4 or more of each trajectory"), "{failure}");
}

#[tokio::test]
async fn an_evaluation_that_no_file_answers_is_refused_at_submission() {
    let laboratory = Laboratory::new().await;
    let dataset = laboratory.imported("held.csv", &laboratory.each(held)).await;
    let mine = |name: &str| json!([named(name, dataset)]);
    for (name, reason) in [
        ("arx", "another name than that of a baseline"),
        ("robomorph", "another name than that of a model of torqued"),
        ("my gru", "1 to 60 letters, digits"),
        ("", "1 to 60 letters, digits"),
    ] {
        let refusal = laboratory.refusal(&mine(name), &json!({})).await;
        assert!(refusal.contains(reason) && refusal.contains("predictions[0].name"), "{refusal}");
    }
    let other = laboratory.imported("truth.csv", &laboratory.each(truth)).await;
    let few = laboratory.imported("few.csv", &laboratory.each(truth)[..5]).await;
    let stream = json!({"stream": {
        "trajectories": 2, "samples": 60, "excitation": {"chirp": {"frequency_hz": {"fixed": 0.2}}},
    }});
    for (predictions, more, reason) in [
        (json!([named("a", dataset), named("a", other)]), json!({}), "each name once"),
        (json!([named("a", dataset), named("b", dataset)]), json!({}), "each dataset once"),
        (mine("a"), json!({"position_noise_rad": [0, 1e-3]}), "position_noise_rad"),
        (mine("a"), json!({"data": stream}), "whose contexts the model was given"),
        (json!([{"name": "a", "data": stream}]), json!({}), "the dataset that an import"),
        (mine("a"), json!({"horizon": 10}), "samples 10, as this evaluation has"),
        (mine("a"), json!({"context": 39}), "an import with samples 20"),
        (mine("a"), json!({"rounds": 2}), "samples 18, as this evaluation has"),
        (json!([named("a", 1)]), json!({}), "an import of a file of predictions"),
        (json!([named("a", 99)]), json!({}), "predictions[0].data.dataset"),
        (json!([named("a", few)]), json!({}), "at least one for each of the 12 scenarios"),
        (json!([]), json!({"baselines": []}), "checkpoint, baseline or file of predictions"),
    ] {
        let refusal = laboratory.refusal(&predictions, &more).await;
        assert!(refusal.contains(reason), "{reason}: {refusal}");
    }

    // A mapping by hand.
    let names = |quantity: &str| (1..=7).map(|k| format!("{quantity}{k}")).collect::<Vec<_>>();
    let mapping = |more: Value| {
        let mut mapping =
            json!({"columns": {"recording": "trajectory", "u": names("u"), "q": names("q")}});
        for (field, value) in more.as_object().unwrap() {
            mapping[field] = value.clone();
        }
        let path = laboratory.folder.path().join("mapping.json");
        std::fs::write(&path, mapping.to_string()).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let file = laboratory.folder.path().join("truth.csv");
    for (more, reason) in [
        (json!({"samples": 20, "rate_hz": 50}), "rate_hz 60, as this evaluation has"),
        (json!({"samples": 20, "split": {"kind": "windows", "stride": 20}}), "split"),
        (
            json!({
                "samples": 20, "columns": {"u": names("u"), "q": names("q")},
                "split": {"kind": "windows", "stride": 20},
                // The next trajectory begins elsewhere.
                "ranges": {"qd_rad_s": [-1e6, 1e6]},
            }),
            "columns.recording",
        ),
    ] {
        let (code, output) = laboratory.import_with(&file, &["--spec", &mapping(more)]);
        assert_eq!(code, Some(0), "{output}");
        let dataset = &laboratory.product.get("/v1/datasets").await["datasets"][0]["id"];
        let refusal =
            laboratory.refusal(&json!([named("a", dataset.as_i64().unwrap())]), &json!({})).await;
        assert!(refusal.contains(reason), "{reason}: {refusal}");
    }
}

#[tokio::test]
async fn a_file_that_does_not_answer_every_scenario_is_refused_where_it_is_read() {
    let laboratory = Laboratory::new().await;
    // The import knows the file alone.
    let options = ["--predictions-of", "1", "--context", "40"];
    let mut broken = laboratory.each(held);
    broken[3].2[7][2] = f64::NAN;
    let (code, output) = laboratory.import_with(&laboratory.write("nan.csv", &broken), &options);
    assert_eq!(code, Some(3), "{output}");
    assert!(output.contains("recording \"3\"") && output.contains("\"q3\""), "{output}");
    let mut short = laboratory.each(held);
    short[4].2.pop();
    let (code, output) = laboratory.import_with(&laboratory.write("short.csv", &short), &options);
    assert_eq!(code, Some(3), "{output}");
    assert!(
        output.contains("recording \"4\"") && output.contains("19 samples, allowed: samples = 20"),
        "{output}"
    );
    let (code, output) = laboratory.import_with(
        &laboratory.write("held.csv", &broken),
        &["--predictions-of", "1", "--context", "60"],
    );
    assert_eq!(code, Some(1), "{output}");
    assert!(output.contains("--context is 60; allowed: less than the 60 samples"), "{output}");

    // The cells know the data.
    let mut unknown = laboratory.each(held);
    unknown[11].0 = "12".to_owned();
    let mut text = laboratory.each(held);
    text[0].0 = "arm 0".to_owned();
    let mut twice = laboratory.each(held);
    twice.push(("2".to_owned(), &laboratory.trajectories[2], held(&laboratory.trajectories[2])));
    let mut swapped = laboratory.each(held);
    swapped[5].1 = &laboratory.trajectories[6];
    let mut without = laboratory.each(held);
    without[1].0 = "7/0".to_owned();
    for (name, recordings, reasons) in [
        ("unknown.csv", unknown, ["recording \"12\"", "trajectories 0 to 11"]),
        ("text.csv", text, ["recording \"arm 0\"", "trajectory and sample, \"7/0\""]),
        ("twice.csv", twice, ["recording \"2\" twice", "each once"]),
        ("swapped.csv", swapped, ["step 40 of trajectory 5", "a prediction begins at step 40"]),
        ("without.csv", without, ["without a prediction of trajectory 1", "0 to 5; 1 missing"]),
    ] {
        let dataset = laboratory.imported(name, &recordings).await;
        let failure = laboratory.failure(dataset, &json!({})).await;
        assert!(failure.contains("predictions[0].data is "), "{failure}");
        assert!(failure.contains("of \"mine\", allowed: "), "{failure}");
        for reason in reasons {
            assert!(failure.contains(reason), "{reason}: {failure}");
        }
    }

    // A window that begins a sample early.
    let early = laboratory.each(|trajectory| trajectory.q[CONTEXT - 1..SAMPLES - 1].to_vec());
    let early = laboratory.write_from("early.csv", &early, CONTEXT - 1);
    let failure = laboratory.failure(laboratory.imported_file(&early).await, &json!({})).await;
    assert!(failure.contains("N·m at step 40 of trajectory 0"), "{failure}");
}

#[tokio::test]
async fn a_name_that_a_checkpoint_has_is_refused() {
    let laboratory = Laboratory::new().await;
    let dataset = laboratory.imported("held.csv", &laboratory.each(held)).await;
    let train = |seed: i32| {
        json!({
            "kind": "train", "data": {"dataset": 1}, "context": CONTEXT, "batch_size": 4, "steps": 2,
            "seed": seed, "model": {"preset": "lagrangian-tiny"}, "validation_fraction": 0,
        })
    };
    let mut evaluate = evaluation(&json!([named("first", dataset)]), &json!({}));
    evaluate["checkpoints"] = json!([{"job": "first"}, {"job": "second"}]);
    let pipeline = pipeline_of(&train(1), &train(2), &evaluate);
    let job = laboratory.product.submit(&pipeline).await;
    let job = laboratory.product.finished(job).await;
    let evaluation = member(&job, "evaluate");
    let error =
        laboratory.product.get(&format!("/v1/jobs/{evaluation}")).await["error"].to_string();
    assert!(error.contains("predictions[0].name is \\\"first\\\""), "{error}");
    assert!(error.contains("another name than that of a checkpoint"), "{error}");
}

fn pipeline_of(first: &Value, second: &Value, evaluate: &Value) -> Value {
    json!({
        "kind": "pipeline", "name": "names",
        "jobs": {"first": first, "second": second, "evaluate": evaluate},
    })
}

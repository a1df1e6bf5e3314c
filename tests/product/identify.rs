//! From a URDF and logs to an identified arm, on the command line.

use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::product::{Product, run_to_end, torqued};

/// A pendulum about a horizontal axis. The described link weighs 2 kg, the true one 2.2 kg.
pub const URDF: &str = r#"<?xml version="1.0"?>
<robot name="pendulum">
  <!-- the stand -->
  <link name="stand"/>
  <joint name="hinge" type="revolute">
    <parent link="stand"/>
    <child link="rod"/>
    <axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="20" velocity="6"/>
  </joint>
  <link name="rod">
    <inertial>
      <origin xyz="0.3 0 0"/>
      <mass value="2"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/>
    </inertial>
  </link>
</robot>
"#;

const MASS_KG: f64 = 2.2;
const LENGTH_M: f64 = 0.3;
const COULOMB_NM: f64 = 0.5;
const VISCOUS_NM_S_RAD: f64 = 0.8;

/// A log of the true pendulum with the rotor of its motor, as text with a cut last line. `phase`
/// makes another motion.
pub fn log(phase: f64) -> String {
    const WAVES: [(f64, f64); 3] = [(0.8, 0.2), (0.4, 0.5), (0.15, 1.1)];
    const ROTOR_KG_M2: f64 = 0.1;

    let mut text = "t;q1;u1\n".to_owned();
    for sample in 0..2500_u32 {
        let t = f64::from(sample) * 0.008;
        let sum = |value: &dyn Fn(f64, f64, f64) -> f64| -> f64 {
            WAVES.iter().map(|(a, hz)| value(*a, TAU * hz, TAU * hz * t + phase / hz)).sum()
        };
        let q = sum(&|a, _, angle| a * angle.sin());
        let qd = sum(&|a, w, angle| a * w * angle.cos());
        let qdd = sum(&|a, w, angle| -a * w * w * angle.sin());
        let inertia = 0.02 + MASS_KG * LENGTH_M * LENGTH_M + ROTOR_KG_M2;
        let gravity = -MASS_KG * 9.81 * LENGTH_M * q.cos();
        let friction = COULOMB_NM * (qd / 0.04).tanh() + VISCOUS_NM_S_RAD * qd;
        let u = inertia * qdd + gravity + friction;
        let line = format!("{t:.4};{q:.7};{u:.5}").replace('.', ",");
        writeln!(text, "{line}").unwrap();
    }
    text + "20,0;0,1"
}

pub fn identify(folder: &Path, more: &[&str]) -> (Option<i32>, String, String) {
    let files = ["arm.urdf", "one.csv", "two.csv", "--validate", "three.csv"];
    let flags = ["--separator", ";", "--decimal-comma", "--out", "found"];
    let mut command = torqued(&["identify"]);
    run_to_end(command.args(files).args(flags).args(more).current_dir(folder))
}

pub fn read_json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

#[test]
fn a_urdf_and_logs_become_an_identified_urdf() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("arm.urdf"), URDF).unwrap();
    for (name, phase) in [("one", 0.3), ("two", 0.7), ("three", 0.1)] {
        fs::write(folder.join(name).with_extension("csv"), log(phase)).unwrap();
    }
    let (code, output, errors) = identify(folder, &[]);
    assert_eq!(code, Some(0), "{errors}");
    assert!(
        errors.contains("one.csv: line 2502, the last one, is cut off and was left out"),
        "{errors}"
    );
    assert!(output.contains("Errors on the validation, °"), "{output}");

    let found = folder.join("found");
    let description = read_json(&found.join("description.json"));
    let joint = &description["joints"][0];
    let number = |value: &Value| value.as_f64().unwrap();
    let within =
        |value: f64, truth: f64| assert!((value / truth - 1.0).abs() < 0.03, "{value} {truth}");
    let mass = number(&joint["link"]["mass_kg"]);
    let center = [0, 1, 2].map(|axis| number(&joint["link"]["center_m"][axis]));
    within(mass * center.iter().map(|c| c * c).sum::<f64>().sqrt(), MASS_KG * LENGTH_M);
    within(number(&joint["damping_nm_s_rad"]), VISCOUS_NM_S_RAD);
    within(0.5 * number(&joint["friction"]["phi1_nm"]), COULOMB_NM);

    let parameters = fs::read_to_string(found.join("parameters.csv")).unwrap();
    assert_eq!(parameters.lines().count(), 1 + 16);
    let report = read_json(&found.join("report.json"));
    let errors = report["arm"]["validation_errors"].as_array().unwrap();
    let of = |name: &str| {
        let errors = errors.iter().find(|errors| errors["predictor"] == name).unwrap();
        number(&errors["rmse_deg"][2])
    };
    assert!(of("identified") < 0.1 * of("description"), "{errors:?}");

    // The identified URDF is the old one with other numbers, and the same arm.
    let urdf = fs::read_to_string(found.join("arm.urdf")).unwrap();
    assert!(urdf.contains("<!-- the stand -->"));
    let mut show = torqued(&["robot", "show", "found/arm.urdf", "--json"]);
    let (code, shown, errors) = run_to_end(show.current_dir(folder));
    assert_eq!(code, Some(0), "{errors}");
    let shown: Value = serde_json::from_str(&shown).unwrap();
    let again = number(&shown["joints"][0]["link"]["mass_kg"]);
    assert!((again - mass).abs() < 1e-9, "{again} {mass}");
    assert!(fs::read_to_string(found.join("arm.xml")).unwrap().contains("<mujoco"));

    let (code, _, errors) = identify(folder, &[]);
    assert_eq!(code, Some(1));
    assert!(
        errors.contains("found has files, allowed: a folder that is empty or does not exist"),
        "{errors}"
    );
}

#[test]
fn logs_that_do_not_fit_the_arm_are_refused_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("arm.urdf"), URDF).unwrap();
    for name in ["one.csv", "two.csv", "three.csv"] {
        fs::write(folder.join(name), log(0.2)).unwrap();
    }
    for (flags, said) in [
        (&["--q", "q1,u1"][..], "--q names 2 columns, allowed: 1, one per joint"),
        (&["--time", "zeit"], "there is no column \"zeit\", only t, q1, u1"),
        (&["--angle", "grad"], "possible values: rad, deg"),
        (&["--low-pass-hz", "70"], "--low-pass-hz is 70 Hz, allowed for recording \"one.csv\""),
        (&["--gain-deviation", "2"], "--gain-deviation is 2, allowed: 0 to 1"),
        (&["--most-delay-s", "1"], "--most-delay-s is 1, allowed: 0 to 0.1"),
        (&["--same-load"], "--load"),
    ] {
        let (code, _, errors) = identify(folder, flags);
        assert!(matches!(code, Some(1 | 2)), "{flags:?}");
        assert!(errors.contains(said), "{errors}");
    }
    let mut command = torqued(&["identify", "arm.urdf", "one.csv", "--separator", "ab"]);
    let (code, _, errors) = run_to_end(command.current_dir(folder));
    assert_eq!(code, Some(2), "{errors}");
    assert!(errors.contains("allowed: one character, or \\t for a tab"), "{errors}");
}

#[test]
fn what_is_wrong_in_a_log_is_named_with_its_line_and_column() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("arm.urdf"), URDF).unwrap();
    let head = "t,q1,u1\n0,1,2\n0.01,1,2\n";
    for (line, said) in [
        ("0.02,x,2\n0.03,1,2\n", &["line 4, column \"q1\"", "\"x\""][..]),
        ("-1,1,2\n", &["line 4, column \"t\"", "times that rise"]),
        ("5,1,2\n", &["line 4", "4.99 s after the row before", "max_gap_s = 0.1"]),
        ("0.02,1\n0.03,1,2\n", &["line 4"]),
        ("0.02,40,2\n", &["line 4, column \"q1\": 40 rad, allowed: -20 to 20 rad", "degrees"]),
    ] {
        fs::write(folder.join("log.csv"), format!("{head}{line}")).unwrap();
        let mut command = torqued(&["identify", "arm.urdf", "log.csv"]);
        let (code, _, errors) = run_to_end(command.current_dir(folder));
        assert_eq!(code, Some(1), "{line:?}");
        for said in said {
            assert!(errors.contains("log.csv") && errors.contains(said), "{said}: {errors}");
        }
    }
}

/// The same log as text and as numbers in degrees with recordings that a mapping names.
#[test]
fn a_mapping_says_what_other_files_hold() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("arm.urdf"), URDF).unwrap();
    let text = |phase: f64, run: u32, lines: &mut String| {
        for line in log(phase)
            .replace(',', ".")
            .lines()
            .skip(1)
            .filter(|line| line.matches(';').count() == 2)
        {
            let values: Vec<f64> = line.split(';').map(|value| value.parse().unwrap()).collect();
            writeln!(
                lines,
                "{run},{},{},{}",
                1000.0 * values[0],
                values[1].to_degrees(),
                values[2]
            )
            .unwrap();
        }
    };
    let mut both = "run,ms,pos,tau\n".to_owned();
    text(0.3, 1, &mut both);
    text(0.7, 2, &mut both);
    fs::write(folder.join("both.csv"), both).unwrap();
    for (name, phase) in [("one", 0.3), ("two", 0.7)] {
        fs::write(folder.join(name).with_extension("csv"), log(phase)).unwrap();
    }
    let mapping = json!({
        "columns": {"time": "ms", "recording": "run", "q": ["pos"], "u": ["tau"]},
        "units": {"time": "ms", "angle": "deg"},
    });
    fs::write(folder.join("mapping.json"), mapping.to_string()).unwrap();
    let found = |arguments: &[&str], out: &str| -> Value {
        let flags = ["--motion-steps", "0", "--out", out];
        let mut command = torqued(&["identify", "arm.urdf"]);
        let (code, _, errors) = run_to_end(command.args(arguments).args(flags).current_dir(folder));
        assert_eq!(code, Some(0), "{errors}");
        read_json(&folder.join(out).join("description.json"))
    };
    let mapped = found(&["both.csv", "--mapping", "mapping.json"], "mapped");
    let plain = found(&["one.csv", "two.csv", "--separator", ";", "--decimal-comma"], "plain");
    let mass = |found: &Value| found["joints"][0]["link"]["mass_kg"].as_f64().unwrap();
    assert!(
        (mass(&mapped) / mass(&plain) - 1.0).abs() < 1e-6,
        "{} {}",
        mass(&mapped),
        mass(&plain)
    );

    let mut command = torqued(&["identify", "arm.urdf", "both.csv", "--mapping", "mapping.json"]);
    let (code, _, errors) = run_to_end(command.args(["--q", "pos"]).current_dir(folder));
    assert_eq!(code, Some(2));
    assert!(errors.contains("--mapping"), "{errors}");
}

/// The server's copy of the URDF gets the numbers, as a file's does.
#[tokio::test]
async fn an_arm_that_a_server_keeps_is_identified_as_from_its_urdf() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    fs::write(folder.join("arm.urdf"), URDF).unwrap();
    fs::write(folder.join("log.csv"), log(0.3)).unwrap();
    let server = ["--server", product.url.as_str()];
    let mut add = torqued(&["robot", "add", "arm.urdf", "--name", "my arm"]);
    let (code, _, errors) = run_to_end(add.args(server).current_dir(folder));
    assert_eq!(code, Some(0), "{errors}");
    let identify = |arm: &str, out: &str, more: &[&str]| {
        let mut command = torqued(&["identify", arm, "log.csv", "--motion-steps", "0"]);
        let text = ["--separator", ";", "--decimal-comma", "--out", out];
        run_to_end(command.args(text).args(more).current_dir(folder))
    };
    for (arm, out, more) in
        [("arm.urdf", "file", &[][..]), ("my arm", "name", &server), ("1", "id", &server)]
    {
        let (code, _, errors) = identify(arm, out, more);
        assert_eq!(code, Some(0), "{arm}: {errors}");
    }
    for file in ["arm.urdf", "arm.xml", "description.json", "parameters.csv", "report.json"] {
        let [of_file, of_name, of_id] = ["file", "name", "id"]
            .map(|out| fs::read_to_string(folder.join(out).join(file)).unwrap());
        assert_eq!(of_name, of_file, "{file}");
        assert_eq!(of_id, of_file, "{file}");
    }

    let (code, _, errors) = identify("1", "nowhere", &[]);
    assert_eq!(code, Some(1));
    assert!(errors.contains("--server URL names a server that keeps it"), "{errors}");
    let (code, _, errors) = identify("2", "nowhere", &server);
    assert_eq!(code, Some(1));
    assert!(errors.contains("there is no robot 2"), "{errors}");
    assert!(!folder.join("nowhere").exists());
}

/// The pendulum's logs as datasets, which the commands of a user make: `one`, `two` and `three`.
pub fn import(product: &Product, folder: &Path) -> [Value; 3] {
    fs::write(folder.join("arm.urdf"), URDF).unwrap();
    let (code, arm, errors) =
        run_to_end(torqued(&["robot", "show", "arm.urdf", "--json"]).current_dir(folder));
    assert_eq!(code, Some(0), "{errors}");
    let arm: Value = serde_json::from_str(&arm).unwrap();
    let name = ["--name", "the pendulum of the lab"];
    let mut add = torqued(&["robot", "add", "arm.urdf", "--server", &product.url]);
    let (code, _, errors) = run_to_end(add.args(name).current_dir(folder));
    assert_eq!(code, Some(0), "{errors}");
    let spec = json!({
        "kind": "import", "format": "csv", "columns": {"time": "t", "u": ["u1"], "q": ["q1"]},
        "robot": {"model": arm}, "ranges": {"u_nm": [-50, 50]},
        "rate_hz": 125, "samples": 2400, "split": {"kind": "windows", "stride": 2400},
    });
    fs::write(folder.join("import.json"), spec.to_string()).unwrap();
    let mut dataset = 0;
    [0.3, 0.7, 0.1].map(|phase| {
        let text = log(phase).replace(',', ".").replace(';', ",");
        let (whole, _) = text.rsplit_once('\n').unwrap();
        fs::write(folder.join("log.csv"), whole).unwrap();
        let spec = ["log.csv", "--spec", "import.json", "--wait", "--server", &product.url];
        let (code, output, errors) =
            run_to_end(torqued(&["import"]).args(spec).current_dir(folder));
        assert_eq!(code, Some(0), "{output}{errors}");
        dataset += 1;
        json!({"dataset": dataset})
    })
}

#[tokio::test]
async fn an_identification_is_a_job_that_survives_its_worker() {
    let folder = tempfile::tempdir().unwrap();
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let [one, two, three] = import(&product, folder.path());
    let spec = json!({"kind": "identify", "data": one, "validation": two, "load": three});
    let first = product.submit(&spec).await;
    let first = product.succeeded(first).await;
    assert_eq!(first["progress"]["done"], 100);
    let run = product.get(&format!("/v1/runs/{}", first["run"])).await;
    let digests = |run: &Value| -> Vec<(Value, Value)> {
        let files = run["artifacts"].as_array().unwrap().iter();
        files.map(|file| (file["name"].clone(), file["sha256"].clone())).collect()
    };
    let names: Vec<Value> = digests(&run).into_iter().map(|(name, _)| name).collect();
    for name in
        ["report.json", "description.json", "parameters.csv", "arm.urdf", "arm.xml", "motion.svg"]
    {
        assert!(names.contains(&json!(name)), "{names:?}");
    }
    let file = |name: &str| format!("/v1/runs/{}/artifacts/{name}", first["run"]);
    let report = product.get(&file("report.json")).await;
    let error = |name: &str| {
        let errors = report["arm"]["validation_errors"].as_array().unwrap();
        let errors = errors.iter().find(|errors| errors["predictor"] == name).unwrap();
        errors["rmse_deg"][2].as_f64().unwrap()
    };
    assert!(error("identified") < 0.1 * error("description"), "{report:#}");
    // The third log has no load: a load of next to nothing is found.
    let load = report["load"]["parameters"].as_array().unwrap();
    let mass = load.iter().find(|parameter| parameter["name"] == "load_mass").unwrap();
    assert!(mass["value"].as_f64().unwrap() < 0.2, "{mass}");

    // The server keeps the identified arm, and it is simulated at once.
    let robot = product.get("/v1/robots").await["robots"][0].clone();
    assert_eq!((&robot["job"], &robot["digest"]), (&first["id"], &report["robot"]), "{robot:#}");
    assert_eq!(robot["name"], "the pendulum of the lab, identified");
    let simulation = json!({
        "kind": "simulate", "trajectories": 2, "samples": 60,
        "robot": {"model": {"robot": robot["id"]}, "friction": {}, "gravity": "on"},
        "excitation": {"multisine": {"frequency_hz": {"fixed": 0.1}}},
    });
    let simulation = product.submit(&simulation).await;
    product.succeeded(simulation).await;

    // A worker dies in the middle. The next one gives the same files.
    let (_, again) = product.post("/v1/jobs?force=true", spec.to_string()).await;
    let again = again["id"].as_i64().unwrap();
    product.task_when(again, |task| task["progress"]["done"].as_u64() > Some(0)).await;
    product.kill_worker().await;
    let again = product.succeeded(again).await;
    let repeated = product.get(&format!("/v1/runs/{}", again["run"])).await;
    assert_eq!(digests(&repeated), digests(&run));
}

#[tokio::test]
async fn several_datasets_are_fitted_together_and_each_has_its_load() {
    let folder = tempfile::tempdir().unwrap();
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let [one, two, three] = import(&product, folder.path());
    let spec = json!({
        "kind": "identify", "data": [one, two], "validation": [three], "load": [two, three],
        "motion_steps": 0, "most_delay_s": 0.02,
    });
    let job = product.submit(&spec).await;
    let job = product.succeeded(job).await;
    let file = |name: &str| format!("/v1/runs/{}/artifacts/{name}", job["run"]);
    let report = product.get(&file("report.json")).await;
    let loads = report["loads"].as_array().unwrap();
    let names: Vec<&Value> = loads.iter().map(|load| &load["recordings"]).collect();
    assert_eq!(names, ["load[0]", "load[1]"]);
    for load in loads {
        assert!(load["mass_kg"].as_f64().unwrap() < 0.2, "{load}");
    }
    for name in ["loaded.json", "load.csv", "loaded-2.json", "load-2.csv"] {
        product.download(&file(name)).await;
    }
    // The logs were written without a delay.
    let parameters = report["arm"]["parameters"].as_array().unwrap();
    let delay = parameters.iter().find(|parameter| parameter["name"] == "delay").unwrap();
    assert!(delay["value"].as_f64().unwrap().abs() < 0.001, "{delay}");

    let page = product.download(&format!("/jobs/{}", job["id"])).await;
    let page = String::from_utf8(page).unwrap();
    assert!(page.contains("Loads, in the hand") && page.contains("load[1]"), "{page}");

    // One dataset and a list of this one have the same result, in the file's bytes, too.
    let found = async |data: Value| {
        let job =
            product.submit(&json!({"kind": "identify", "data": data, "motion_steps": 0})).await;
        let job = product.succeeded(job).await;
        product.get(&format!("/v1/runs/{}/artifacts/description.json", job["run"])).await
    };
    assert_eq!(found(one.clone()).await, found(json!([one])).await);
}

#[tokio::test]
async fn an_identification_names_what_does_not_fit() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let simulate = |gravity: &str, samples: u32| {
        json!({
            "kind": "simulate", "trajectories": 1, "samples": samples,
            "robot": {"gravity": gravity}, "excitation": {"chirp": {"frequency_hz": {"fixed": 0.2}}},
        })
    };
    let refused = async |spec: Value, said: &str| {
        let (status, answer) = product.post("/v1/jobs", spec.to_string()).await;
        assert_eq!(status.as_u16(), 422, "{answer:#}");
        assert!(answer.to_string().contains(said), "{answer:#}");
    };
    let identify = |simulation: Value| {
        json!({
            "kind": "pipeline",
            "name": "identification",
            "jobs": {
                "data": simulation,
                "arm": {"kind": "identify", "data": {"job": "data"}},
            },
        })
    };
    refused(identify(simulate("compensated", 300)), "lack the arm's weight").await;
    refused(identify(simulate("on", 100)), "trajectories of 1.67 s").await;
    let nobody = json!({"kind": "identify", "data": {"dataset": 7}});
    refused(nobody, "the id of a dataset").await;
    let stream = json!({"kind": "identify", "data": {"stream": {"preset": "D1-chirp"}}});
    refused(stream, "a stream").await;

    // Two simulated arms are no one arm.
    let mut spec = identify(json!({"preset": "panda-real", "trajectories": 2, "samples": 300}));
    spec["jobs"]["arm"]["motion_steps"] = json!(0);
    let job = product.submit(&spec).await;
    let arm = crate::product::member(&product.succeeded(job).await, "arm");
    let arm = product.get(&format!("/v1/jobs/{arm}")).await;
    let report = product.get(&format!("/v1/runs/{}/artifacts/report.json", arm["run"])).await;
    let warnings = report["arm"]["warnings"].to_string();
    assert!(warnings.contains("data is a simulation whose arms differ"), "{warnings}");
}

/// Runs on the recordings of a real UR10e, which are not part of the repository.
#[test]
fn a_real_ur10e_is_predicted_on_another_day_and_its_load_is_found() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/reference/real/ur10e");
    if !folder.exists() {
        println!("skipped: there are no recordings of a UR10e beside the repository");
        return;
    }
    let out = tempfile::tempdir().unwrap();
    let out = out.path().join("found");
    let mut command = torqued(&["identify", "ur10e.urdf", "ur-20_02_12-40sec_12harm.csv"]);
    command.args(["ur-20_02_12-50sec_12harm.csv", "--validate", "ur-20_02_19_14harm50sec.csv"]);
    command.args(["--load", "ur-20_02_19_14harm50secLoad.csv", "--time", "1", "--q", "2-7"]);
    command.args(["--u", "14-19", "--gains", "14.87,13.26,11.13,10.62,11.03,11.47", "--out"]);
    let (code, _, errors) = run_to_end(command.arg(&out).current_dir(folder));
    assert_eq!(code, Some(0), "{errors}");
    let report = read_json(&out.join("report.json"));
    let of = |errors: &Value, horizon: usize| {
        let errors = errors.as_array().unwrap();
        let identified = errors.iter().find(|errors| errors["predictor"] == "identified").unwrap();
        identified["rmse_deg"][horizon].as_f64().unwrap()
    };
    for (horizon, limit_deg) in [0.031, 0.36, 1.45].into_iter().enumerate() {
        let error = of(&report["arm"]["validation_errors"], horizon);
        assert!(error < limit_deg, "{horizon}: {error}");
    }
    assert!(of(&report["load"]["errors"], 2) < 2.0);
    let parameters = report["load"]["parameters"].as_array().unwrap();
    let mass = parameters.iter().find(|parameter| parameter["name"] == "load_mass").unwrap();
    assert!((mass["value"].as_f64().unwrap() - 2.805).abs() < 0.15, "{mass}");
}

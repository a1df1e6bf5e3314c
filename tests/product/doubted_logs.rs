//! Logs with the other sign are doubted, by an identification as by an import.

use std::fs;

use serde_json::{Value, json};

use crate::identify::{URDF, identify, import, log, read_json};
use crate::product::{Product, run_to_end, torqued};

#[test]
fn a_log_with_the_other_sign_is_named_among_others() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("arm.urdf"), URDF).unwrap();
    let turned = |line: &str| -> String {
        let fields: Vec<&str> = line.split(';').collect();
        match fields.as_slice() {
            [t, q, u] if *t != "t" => match u.strip_prefix('-') {
                Some(u) => format!("{t};{q};{u}\n"),
                None => format!("{t};{q};-{u}\n"),
            },
            _ => format!("{line}\n"),
        }
    };
    fs::write(folder.join("one.csv"), log(0.3)).unwrap();
    fs::write(folder.join("two.csv"), log(0.7)).unwrap();
    let validation: String = log(0.1).lines().map(turned).collect();
    fs::write(folder.join("three.csv"), validation).unwrap();
    let (code, output, errors) = identify(folder, &["--motion-steps", "0"]);
    assert_eq!(code, Some(0), "{errors}");
    let warnings: Vec<&str> = output.lines().filter(|line| line.starts_with("warning: ")).collect();
    let of_sign = |warning: &&&str| warning.contains("of joint 1 seems to have the other sign");
    let found: Vec<&&str> = warnings.iter().filter(of_sign).collect();
    let [warning] = found.as_slice() else { panic!("{output}") };
    assert!(warning.starts_with("warning: three.csv: u"), "{warning}");
}

#[tokio::test]
async fn a_log_with_the_other_sign_is_doubted_before_and_after_its_import() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    import(&product, folder);
    let check = |flags: &[&str]| {
        let file = ["log.csv", "--spec", "import.json", "--check", "--server", &product.url];
        let (code, output, errors) =
            run_to_end(torqued(&["import"]).args(file).args(flags).current_dir(folder));
        assert_eq!(code, Some(0), "{output}{errors}");
        output
    };
    let right = check(&[]);
    assert!(right.contains("recordings: 1, rows: 2500, trajectories: 1"), "{right}");
    assert!(right.contains("Torques beside the robot's") && !right.contains("warning"), "{right}");

    // The server knows the robot of the spec. Only u is turned.
    let spec = read_json(&folder.join("import.json"));
    let by_id = json!({"robot": {"model": {"robot": 1}, "gravity": "on"}});
    let mut spec = spec.as_object().unwrap().clone();
    spec.extend(by_id.as_object().unwrap().clone());
    spec.insert(
        "columns".to_owned(),
        json!({"time": "t", "u": ["u1"], "q": ["q1"], "gains": [-1]}),
    );
    fs::write(folder.join("import.json"), Value::from(spec).to_string()).unwrap();
    let turned = check(&["--json"]);
    let turned: Value = serde_json::from_str(&turned).unwrap();
    assert_eq!(turned["check"]["channels"][0]["sign"], -1, "{turned:#}");
    // The torques of a single joint do not tell whether it is u or q.
    let said = "u or q of joint 1 seems to have the other sign. The torques do not tell which";
    assert_eq!(turned["check"]["doubts"][0], said, "{turned:#}");
    assert_eq!(product.get("/v1/jobs").await["jobs"].as_array().unwrap().len(), 3);

    let flags = ["log.csv", "--spec", "import.json", "--wait", "--server", &product.url];
    let (code, output, errors) = run_to_end(torqued(&["import"]).args(flags).current_dir(folder));
    assert_eq!(code, Some(0), "{output}{errors}");
    assert!(output.contains(&format!("warning: {said}")), "{output}");
    let tasks = product.get("/v1/jobs/4/tasks").await;
    let result = &tasks["tasks"][0]["result"];
    assert_eq!(result["check"], turned["check"], "{result:#}");
    let page = String::from_utf8(product.download("/datasets/4").await).unwrap();
    assert!(page.contains(said) && page.contains("Torques beside the robot"), "{page}");
}

//! Devices from outside: the list of devices, the refusal of one that cannot be used, and, where
//! this build has it, a pipeline on a GPU.

use std::process::Command;

use crate::product::{run_to_end, torqued};

/// Checks that `torqued` ends with `code` and a line of standard error that begins with `error: `
/// and contains `expected`.
#[track_caller]
fn check_refused(command: &mut Command, code: i32, expected: &str) {
    let (found, output, errors) = run_to_end(command);
    assert_eq!(found, Some(code), "{output}{errors}");
    let lines: Vec<&str> = errors.lines().filter(|line| line.starts_with("error: ")).collect();
    assert!(lines.len() == 1 && lines[0].contains(expected), "{expected} is not in {errors:?}");
}

#[test]
fn devices_that_this_build_has_not_are_refused_by_naming_what_it_has() {
    for command in ["serve", "quickstart", "worker"] {
        let unknown = "unknown device `abacus`, allowed: cpu";
        check_refused(&mut torqued(&[command, "--device", "abacus"]), 2, unknown);
        check_refused(torqued(&[command]).env("TORQUED_DEVICE", "abacus"), 2, unknown);
        if cfg!(not(feature = "cuda")) {
            let not_built = "without device `cuda`, allowed: cpu";
            check_refused(&mut torqued(&[command, "--device", "cuda"]), 2, not_built);
        }
    }
}

#[test]
fn instructions_that_the_processor_lacks_are_refused_by_naming_what_it_has() {
    let with = |instructions: &str| {
        let mut command = torqued(&["devices"]);
        command.env("TORQUED_INSTRUCTIONS", instructions);
        command
    };
    check_refused(
        &mut with("sse9"),
        1,
        "TORQUED_INSTRUCTIONS: instruction set \"sse9\": this processor has",
    );
    let (code, output, errors) = run_to_end(&mut with("Portable"));
    assert_eq!(code, Some(0), "{output}{errors}");
}

#[test]
fn devices_are_listed_with_what_became_of_trying_them() {
    let (code, output, errors) = run_to_end(&mut torqued(&["devices"]));
    assert_eq!(code, Some(0), "{errors}");
    let line = |name: &str| {
        let line = output.lines().find(|line| line.starts_with(name));
        line.unwrap_or_else(|| panic!("no {name} in {output}")).to_owned()
    };
    assert!(line("cpu").contains("burn-flex") && line("cpu").ends_with(" s"), "{output}");
    for (name, is_built) in [
        ("gpu", cfg!(feature = "gpu")),
        ("cuda", cfg!(feature = "cuda")),
        ("ndarray", cfg!(feature = "ndarray")),
        ("torch", cfg!(feature = "torch")),
    ] {
        let hint = line(name).contains(&format!("--features {name}"));
        assert_eq!(hint, !is_built, "{output}");
    }
}

#[cfg(feature = "gpu")]
mod on_a_gpu {
    use std::path::Path;

    use serde_json::Value;

    use super::*;
    use crate::product::{Product, member, small_pipeline};

    /// `torqued` in an environment without a Vulkan driver.
    fn without_driver(arguments: &[&str]) -> Command {
        let mut command = torqued(arguments);
        // Loaders older than 1.3.207 use the second name.
        command.env("VK_DRIVER_FILES", "/dev/null").env("VK_ICD_FILENAMES", "/dev/null");
        command
    }

    #[test]
    fn without_a_driver_a_server_and_a_worker_end_with_one_line_and_touch_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("data");
        let expected = "device `gpu` cannot be opened";
        for command in ["serve", "quickstart", "worker"] {
            let arguments = [command, "--device", "gpu", "--data", data.to_str().unwrap()];
            check_refused(&mut without_driver(&arguments), 1, expected);
            assert!(!Path::new(&data).exists(), "{command} made a folder");
        }
        check_refused(&mut without_driver(&["devices", "gpu"]), 1, expected);
    }

    #[test]
    fn a_gpu_is_named_as_its_driver_calls_it() {
        let (code, output, errors) = run_to_end(&mut torqued(&["devices", "gpu"]));
        assert_eq!(code, Some(0), "{errors}");
        let line = output.lines().last().unwrap();
        assert!(line.starts_with("gpu") && line.contains("burn-wgpu"), "{output}");
        assert!(line.ends_with(" s") && line.split_whitespace().count() > 4, "{output}");
    }

    #[tokio::test]
    async fn a_pipeline_trains_and_evaluates_on_it_and_its_checkpoint_says_so() {
        let data = tempfile::tempdir().unwrap();
        let arguments = ["--device", "gpu", "--worker-threads", "1"];
        let product = Product::start_with(data.path(), &arguments);
        let mut spec = small_pipeline();
        spec["jobs"]["train"]["steps"] = 60.into();
        let id = product.submit(&spec).await;
        let pipeline = product.succeeded(id).await;

        let job = member(&pipeline, "train");
        let training = product.get(&format!("/v1/jobs/{job}")).await;
        let ids = training["checkpoints"].as_array().unwrap().iter();
        let last = ids.filter_map(Value::as_i64).max().unwrap();
        let config = product.get(&format!("/v1/checkpoints/{last}/files/config.json")).await;
        assert_eq!(config["step"], 60);
        assert_eq!(config["device"]["name"], "gpu", "{config:#}");
        assert!(config["device"]["adapter"].is_string(), "{config:#}");

        let evaluation = member(&pipeline, "evaluate");
        let evaluation = product.get(&format!("/v1/evaluations/{evaluation}")).await;
        let predictors = evaluation["report"]["predictors"].as_array().unwrap();
        assert!(
            predictors.iter().any(|predictor| predictor["name"] == "robomorph"),
            "{evaluation:#}"
        );
    }
}

//! What a spec that was accepted makes doubtful.

use serde_json::Value;
use spec::{DataSource, Doubt, JobSpec, SimulateSpec};

/// Sentences about the values of a stored spec, those of a pipeline's jobs and of streams included;
/// none about a spec of another version.
pub fn warnings(spec: &Value) -> Vec<String> {
    let spec: Result<JobSpec, _> = serde_json::from_value(spec.clone());
    spec.map_or(Vec::new(), |spec| of_job(&spec, ""))
}

/// `path` leads to the fields of `spec` and ends in a dot, unless it is empty.
fn of_job(spec: &JobSpec, path: &str) -> Vec<String> {
    match spec {
        JobSpec::Simulate(spec) => of_simulation(spec, path),
        JobSpec::Train(spec) => of_source(&spec.data, path),
        JobSpec::Evaluate(spec) => of_source(&spec.data, path),
        JobSpec::Pipeline(pipeline) => pipeline
            .jobs
            .iter()
            .flat_map(|(name, member)| of_job(&member.spec, &format!("{path}jobs.{name}.")))
            .collect(),
        JobSpec::Import(_) | JobSpec::Verify(_) => Vec::new(),
    }
}

fn of_source(source: &DataSource, path: &str) -> Vec<String> {
    match source {
        DataSource::Stream(spec) => of_simulation(spec, &format!("{path}data.stream.")),
        DataSource::Job(_) | DataSource::Dataset(_) | DataSource::Digest(_) => Vec::new(),
    }
}

fn of_simulation(spec: &SimulateSpec, path: &str) -> Vec<String> {
    let sentence = |doubt: Doubt| {
        let Doubt { field, value, reason } = doubt;
        format!("{path}{field} is {value}: {reason}")
    };
    spec.doubts().into_iter().map(sentence).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn of(spec: &Value) -> Vec<String> {
        let spec = spec::parse(spec.to_string().as_bytes()).unwrap();
        warnings(&spec.to_json())
    }

    #[test]
    fn light_damping_is_doubted_wherever_the_simulation_is() {
        let light = json!({"preset": "D1-chirp", "robot": {"damping_nm_s_rad": vec![0.5; 7]}});
        let simulation = of(&light);
        assert!(simulation[0].starts_with("robot.damping_nm_s_rad is "), "{simulation:?}");

        let jobs = json!({"fine": {"preset": "D1-chirp"}, "light": light});
        let pipeline = of(&json!({"kind": "pipeline", "name": "two", "jobs": jobs}));
        assert_eq!(pipeline[0], format!("jobs.light.{}", simulation[0]));

        let training = of(&json!({
            "kind": "train", "steps": 5, "model": {"preset": "robomorph-tiny"},
            "data": {"stream": light},
        }));
        assert_eq!(training[0], format!("data.stream.{}", simulation[0]));
    }

    #[test]
    fn no_preset_is_doubted() {
        for preset in spec::presets() {
            assert_eq!(warnings(&preset.spec), Vec::<String>::new(), "{}", preset.name);
        }
    }
}

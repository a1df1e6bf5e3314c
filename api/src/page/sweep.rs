//! Sweeps: a job for each value of a field.

use serde_json::{Map, Value, json};
use spec::SpecError;

use crate::page::spec_form::put;

/// The pipeline with a copy of a job for each of these values of a field.
///
/// # Errors
/// When the job is a pipeline, the field is not there, or there is no value.
pub fn sweep(spec: &Value, path: &str, values: &[Value]) -> Result<Value, SpecError> {
    let refused = |value: &str, allowed: &str| Err(SpecError::one("sweep", value, allowed));
    if spec["kind"] == "pipeline" {
        return refused("over a pipeline", "a sweep over a single job");
    }
    if path == "kind" || !put(&mut spec.clone(), path, Value::Null) {
        return refused(path, "a field of the spec");
    }
    if values.is_empty() {
        return refused("without values", "values separated by commas, or a list in JSON");
    }
    let kind = spec["kind"].as_str().unwrap_or("job");
    let last = path.rsplit('.').next().unwrap_or(path);
    let jobs: Map<String, Value> = (1..)
        .zip(values)
        .map(|(number, value)| {
            let mut job = spec.clone();
            put(&mut job, path, value.clone());
            (member_name(&format!("{kind}-{number}"), last, value), job)
        })
        .collect();
    let name: String = format!("{kind} over {last}").chars().take(100).collect();
    Ok(json!({ "kind": "pipeline", "name": name, "jobs": jobs }))
}

/// The name of a sweep's job. It ends with the field and its value, as far as names of jobs may.
fn member_name(numbered: &str, field: &str, value: &Value) -> String {
    const LONGEST: usize = 60;

    if value.is_object() || value.is_array() {
        return numbered.to_owned();
    }
    let value = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    let text = format!("{numbered} {field} {value}").to_ascii_lowercase();
    let words = text.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
    let name: String = words.collect::<Vec<_>>().join("-").chars().take(LONGEST).collect();
    name.trim_end_matches('-').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::page::spec_form::values_of;

    #[test]
    fn a_sweep_is_a_pipeline_with_a_job_for_each_value() {
        let training = || {
            let text =
                br#"{"kind": "train", "data": {"stream": {"preset": "D1-multisine"}}, "steps": 100,
                "batch_size": 4, "model": {"preset": "robomorph-tiny"}}"#;
            spec::parse(text).unwrap().to_json()
        };
        let values = values_of("1e-3, 1e-4");
        assert_eq!(values, values_of("[1e-3, 1e-4]"));
        let swept = sweep(&training(), "optimizer.learning_rate", &values).unwrap();
        let jobs = swept["jobs"].as_object().unwrap();
        assert_eq!(
            jobs.keys().collect::<Vec<_>>(),
            ["train-1-learning-rate-0-001", "train-2-learning-rate-0-0001"]
        );
        assert_eq!(jobs["train-2-learning-rate-0-0001"]["optimizer"]["learning_rate"], 1e-4);
        spec::parse_json(swept.clone()).unwrap();
        for (path, values) in [("paint.colour", &values[..]), ("steps", &[]), ("kind", &values[..])]
        {
            assert!(sweep(&training(), path, values).is_err(), "{path}");
        }
        assert!(sweep(&swept, "name", &values).is_err());
    }
}

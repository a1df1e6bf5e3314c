use serde_json::json;
use spec::{DataSpec, IdentifySpec, SpecError};
use store::{NewTask, Output};

use crate::inputs::Inputs;
use crate::kind::{Kind, task};

impl Kind for IdentifySpec {
    fn unit(&self) -> &'static str {
        "%"
    }

    fn tasks(&self, _inputs: &Inputs) -> Result<Vec<NewTask>, SpecError> {
        Ok(vec![task(0, 0, "identify", &json!({}), 100)])
    }

    fn output(&self) -> Output {
        Output::Run
    }

    fn check_inputs(&self, inputs: &Inputs) -> Result<(), SpecError> {
        let found: Vec<&DataSpec> = inputs.data.iter().map(|found| &found.spec).collect();
        Self::check_inputs(self, &found)
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;
    use spec::DataSpec;

    use crate::inputs::FoundData;
    use crate::inputs::tests::{inputs_of, parse};
    use crate::kind::kind;

    #[test]
    fn every_dataset_has_to_fit_the_robot_and_the_rate() {
        let data = parse(&json!({
            "kind": "simulate", "trajectories": 2, "robot": {"gravity": "on"},
            "excitation": {"chirp": {"frequency_hz": {"fixed": 0.2}}},
        }));
        let spec = parse(&json!({
            "kind": "identify", "robot": {"model": "panda"},
            "data": {"digest": "0".repeat(64)}, "load": {"digest": "1".repeat(64)},
        }));
        let found = |load: serde_json::Value| {
            let load = parse(&load);
            let mut inputs = inputs_of(&data);
            inputs.data.push(FoundData::unmade(load.digest(), DataSpec::of(&load).unwrap()));
            kind(&spec).unwrap().check_inputs(&inputs).map_err(|error| error.to_string())
        };
        let simulation = |robot: &str, rate_hz: f64| {
            json!({
                "kind": "simulate", "trajectories": 1, "robot": {"gravity": robot},
                "excitation": {"chirp": {"frequency_hz": {"fixed": 0.2}}}, "rate_hz": rate_hz,
            })
        };
        found(simulation("on", 60.0)).unwrap();
        let weightless = found(simulation("off", 60.0)).unwrap_err();
        assert!(weightless.contains("load") && weightless.contains("gravity"), "{weightless}");
        let faster = found(simulation("on", 100.0)).unwrap_err();
        assert!(faster.contains("100 Hz") && faster.contains("60 Hz"), "{faster}");
        let listed = parse(&json!({
            "kind": "identify", "robot": {"model": "panda"},
            "data": [{"digest": "0".repeat(64)}, {"digest": "1".repeat(64)}],
        }));
        let mut inputs = inputs_of(&data);
        let second = parse(&simulation("on", 100.0));
        inputs.data.push(FoundData::unmade(second.digest(), DataSpec::of(&second).unwrap()));
        let error = kind(&listed).unwrap().check_inputs(&inputs).unwrap_err().to_string();
        assert!(error.contains("data[1] is 100 Hz, allowed: 60 Hz, as data[0] has"), "{error}");
        let one = kind(&spec).unwrap().tasks(&inputs_of(&data)).unwrap();
        assert_eq!((one.len(), one[0].total), (1, 100));
    }
}

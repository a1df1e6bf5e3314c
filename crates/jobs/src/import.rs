use serde_json::json;
use spec::{ImportSpec, SpecError};
use store::{NewTask, Output};

use crate::inputs::Inputs;
use crate::kind::{Kind, task};

impl Kind for ImportSpec {
    fn unit(&self) -> &'static str {
        "trajectories"
    }

    fn tasks(&self, _inputs: &Inputs) -> Result<Vec<NewTask>, SpecError> {
        Ok(vec![task(0, 0, "import", &json!({}), 0)])
    }

    /// Only the task that reads the file learns the number of trajectories.
    fn output(&self) -> Output {
        Output::Dataset { trajectories: 0, samples: self.samples }
    }
}

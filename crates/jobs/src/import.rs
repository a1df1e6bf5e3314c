use std::path::Path;

use serde_json::json;
use spec::{ImportSpec, SpecError};
use store::{NewTask, Output};

use crate::inputs::Inputs;
use crate::kind::{Kind, task};

impl Kind for ImportSpec {
    fn unit(&self) -> &'static str {
        "trajectories"
    }

    /// That of its file or files: `monday`, `monday, tuesday` or `monday and 6 more`.
    fn name(&self, inputs: &Inputs) -> Option<String> {
        let stem = |name: &String| {
            let stem = Path::new(name).file_stem().map(|stem| stem.to_string_lossy().into_owned());
            stem.unwrap_or_else(|| name.clone())
        };
        let names: Vec<String> = match self.files.as_slice() {
            [] => inputs.file_names.iter().map(stem).collect(),
            named => named.iter().map(|file| file.name.clone()).collect(),
        };
        match names.as_slice() {
            [] => None,
            [one] => Some(one.clone()),
            [one, other] => Some(format!("{one}, {other}")),
            [first, others @ ..] => Some(format!("{first} and {} more", others.len())),
        }
    }

    fn tasks(&self, _inputs: &Inputs) -> Result<Vec<NewTask>, SpecError> {
        Ok(vec![task(0, 0, "import", &json!({}), 0)])
    }

    /// Only the task that reads the file learns the number of trajectories.
    fn output(&self) -> Output {
        Output::Dataset { trajectories: 0, samples: self.samples }
    }
}

use serde_json::json;
use spec::{DataSpec, Doubt, SpecError, TrainSpec};
use store::{DatasetState, JobReuse, NewTask, Output, PartReuse};

use crate::inputs::Inputs;
use crate::kind::{Kind, MemoryDoubts, task};

impl Kind for TrainSpec {
    fn unit(&self) -> &'static str {
        "steps"
    }

    fn tasks(&self, _inputs: &Inputs) -> Result<Vec<NewTask>, SpecError> {
        Ok(vec![task(0, 0, "train", &json!({}), self.steps)])
    }

    /// Checkpoints can be copied from an earlier job, with the metrics up to them.
    fn reuse(&self) -> JobReuse {
        JobReuse { whole: true, parts: PartReuse::Objects }
    }

    fn output(&self) -> Output {
        Output::Run
    }

    fn check_inputs(&self, inputs: &Inputs) -> Result<(), SpecError> {
        let data = inputs.data()?;
        self.check_data(&data.spec)?;
        // Only the dataset of an import knows its number of trajectories, once it exists.
        match (&data.spec.trajectories(), &data.dataset) {
            (None, Some(dataset)) if dataset.state == DatasetState::Complete => {
                self.check_trajectories(dataset.trajectories)
            }
            _ => Ok(()),
        }
    }

    fn memory_doubt(&self, data: &DataSpec, memory: &MemoryDoubts) -> Option<Doubt> {
        memory(self, data)
    }
}

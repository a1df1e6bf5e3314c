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
        let data: Vec<&DataSpec> = inputs.data.iter().map(|found| &found.spec).collect();
        self.check_data(&data)?;
        if let (Some(data), Some(init)) = (data.first(), inputs.trainings().first()) {
            self.check_init(data, init)?;
        }
        // Only the dataset of an import knows its number of trajectories, once it exists.
        let counts =
            inputs.data.iter().map(|found| match (&found.spec.trajectories(), &found.dataset) {
                (None, Some(dataset)) if dataset.state == DatasetState::Complete => {
                    Some(dataset.trajectories)
                }
                _ => None,
            });
        self.check_trajectories(&counts.collect::<Vec<_>>())
    }

    fn memory_doubt(&self, data: &DataSpec, memory: &MemoryDoubts) -> Option<Doubt> {
        memory(self, data)
    }
}

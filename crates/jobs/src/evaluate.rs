//! Evaluations: a task for each cell, perhaps one for latencies, and one for the report.

use serde::{Deserialize, Serialize};
use spec::{EvaluateSpec, SpecError};
use store::{DatasetState, JobReuse, NewTask, Output, PartReuse};

use crate::inputs::{FoundData, Inputs};
use crate::kind::{Kind, task};

/// The payload of a task of an evaluation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EvaluateTask {
    /// The cell at this index among those of the spec.
    Cell(u32),
    /// The latency of predictions, measured while no other task of the job runs.
    Latency,
    /// The report on all cells.
    Report,
}

impl Kind for EvaluateSpec {
    fn unit(&self) -> &'static str {
        "scenarios"
    }

    fn tasks(&self, inputs: &Inputs) -> Result<Vec<NewTask>, SpecError> {
        let data = inputs.data()?;
        let cells = (0..).zip(self.cells(&data.spec));
        let complete =
            data.this_dataset().filter(|dataset| dataset.state == DatasetState::Complete);
        let mut tasks: Vec<NewTask> = cells
            .map(|(k, cell)| {
                let found = complete.map(|dataset| dataset.trajectories.saturating_sub(cell.first));
                let scenarios = found.map_or(cell.count, |found| found.min(cell.count));
                task(0, k, cell.to_string(), &EvaluateTask::Cell(k), scenarios)
            })
            .collect();
        let mut report = 1;
        if self.latency.is_some() {
            tasks.push(task(1, 0, "latency", &EvaluateTask::Latency, 0));
            report = 2;
        }
        tasks.push(task(report, 0, "report", &EvaluateTask::Report, 0));
        Ok(tasks)
    }

    fn output(&self) -> Output {
        Output::Run
    }

    /// The result of a cell names the run that has its table.
    fn reuse(&self) -> JobReuse {
        JobReuse { whole: true, parts: PartReuse::Tasks }
    }

    fn check_inputs(&self, inputs: &Inputs) -> Result<(), SpecError> {
        let (data, files) = (inputs.data()?, inputs.other_data());
        let specs: Vec<_> = files.iter().map(|file| &file.spec).collect();
        Self::check_inputs(self, &data.spec, &inputs.trainings(), &specs)?;
        check_files(self, data, files)
    }
}

/// Checks what is known of the datasets of files of predictions: each is there once, and a complete one has at least
/// an answer to each scenario.
fn check_files(
    spec: &EvaluateSpec,
    data: &FoundData,
    files: &[FoundData],
) -> Result<(), SpecError> {
    let scenarios = data.spec.trajectories().map(|_| {
        let trajectories = spec.cells(&data.spec).into_iter().map(|cell| cell.count);
        trajectories.sum::<u64>()
    });
    for (i, file) in files.iter().enumerate() {
        let field = format!("predictions[{i}].data");
        if let Some(other) = files[..i].iter().position(|earlier| earlier.source == file.source) {
            let value = format!("the dataset of predictions[{other}]");
            return Err(SpecError::one(field, value, "each dataset once"));
        }
        let complete =
            file.this_dataset().filter(|dataset| dataset.state == DatasetState::Complete);
        if let (Some(complete), Some(scenarios)) = (complete, scenarios)
            && complete.trajectories < scenarios
        {
            let value =
                format!("dataset {} with {} predictions", complete.id, complete.trajectories);
            let allowed = format!("at least one for each of the {scenarios} scenarios");
            return Err(SpecError::one(field, value, allowed));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use crate::inputs::tests::{inputs_of, parse};
    use crate::kind::kind;

    #[test]
    fn an_evaluation_has_a_task_per_cell_and_a_report_after_them() {
        let inputs = inputs_of(&parse(&json!({"preset": "grid-chirp"})));
        let spec = json!({"kind": "evaluate", "data": {"digest": "0".repeat(64)}});
        let tasks = kind(&parse(&spec)).unwrap().tasks(&inputs).unwrap();
        assert_eq!(tasks.len(), 11);
        assert_eq!((tasks[2].label.as_str(), tasks[2].total), ("chirp 0.3 Hz", 100));
        assert_eq!(tasks[2].payload, json!({"cell": 2}));
        assert_eq!((tasks[10].stage, tasks[10].label.as_str()), (1, "report"));
    }

    #[test]
    fn every_cell_comes_at_every_level_of_noise() {
        let inputs = inputs_of(&parse(&json!({"preset": "grid-chirp"})));
        let spec = json!({
            "kind": "evaluate", "data": {"digest": "0".repeat(64)}, "position_noise_rad": [0, 1e-3],
        });
        let tasks = kind(&parse(&spec)).unwrap().tasks(&inputs).unwrap();
        let labels: Vec<&str> = tasks.iter().map(|task| task.label.as_str()).collect();
        assert_eq!(labels.len(), 21);
        assert_eq!([labels[2], labels[12]], ["chirp 0.3 Hz", "chirp 0.3 Hz at 0.001 rad"]);
        assert_eq!(tasks[12].payload, json!({"cell": 12}));
    }

    #[test]
    fn latencies_are_measured_between_the_cells_and_the_report() {
        let inputs = inputs_of(&parse(&json!({"preset": "grid-chirp"})));
        let spec = json!({"kind": "evaluate", "data": {"digest": "0".repeat(64)}, "latency": {}});
        let tasks = kind(&parse(&spec)).unwrap().tasks(&inputs).unwrap();
        let stages: Vec<_> = tasks.iter().map(|task| (task.stage, task.payload.clone())).collect();
        assert_eq!(stages[10..], [(1, json!("latency")), (2, json!("report"))]);
    }
}

//! The inputs that a job's references point to.

use spec::{CheckpointRef, DataSource, DataSpec, Digest, SpecError, TrainSpec, Training};
use store::{CheckpointId, Dataset, Need};

/// The data and checkpoints that a job refers to.
#[derive(Default)]
pub(crate) struct Inputs {
    pub data: Vec<FoundData>,
    pub checkpoints: Vec<CheckpointRef>,
    /// The training of each checkpoint, with its data.
    pub trainings: Vec<(TrainSpec, DataSpec)>,
    /// Jobs that must succeed first.
    pub needs: Vec<Need>,
    /// The digests of the jobs that make the data and the checkpoints.
    pub reads: Vec<Digest>,
    /// The checkpoints that exist already and need no job.
    pub existing: Vec<CheckpointId>,
    /// Files that were sent.
    pub files: Vec<Digest>,
    /// The names that their senders gave them.
    pub file_names: Vec<String>,
}

impl Inputs {
    /// The trajectories that the job reads.
    ///
    /// # Errors
    /// When it reads no trajectories.
    pub fn data(&self) -> Result<&FoundData, SpecError> {
        self.data.first().ok_or_else(|| SpecError::one("data", "", "a dataset"))
    }

    /// The data beside those that [`Self::data`] gives, in the order of the spec.
    pub fn other_data(&self) -> &[FoundData] {
        self.data.get(1..).unwrap_or_default()
    }

    pub fn trainings(&self) -> Vec<Training<'_>> {
        self.trainings.iter().map(|(spec, data)| Training { spec, data }).collect()
    }
}

/// The trajectories that a job reads.
pub(crate) struct FoundData {
    /// A digest, or a stream.
    pub source: DataSource,
    pub spec: DataSpec,
    /// The job that makes them, unless they are a stream.
    pub need: Option<Need>,
    /// The dataset that this job fills, if it exists already.
    pub dataset: Option<Dataset>,
    /// The dataset that the spec named by its id.
    pub asked: Option<Dataset>,
}

impl FoundData {
    /// The dataset to use where it matters which of several with the same digest it is.
    pub fn this_dataset(&self) -> Option<&Dataset> {
        self.asked.as_ref().or(self.dataset.as_ref())
    }

    #[cfg(test)]
    pub fn unmade(digest: spec::Digest, spec: DataSpec) -> Self {
        let source = DataSource::Digest(digest);
        Self { source, spec, need: None, dataset: None, asked: None }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use serde_json::Value;
    use spec::JobSpec;

    use super::*;

    pub fn parse(spec: &Value) -> JobSpec {
        spec::parse(spec.to_string().as_bytes()).unwrap()
    }

    /// The inputs of a job that reads what `simulation` makes.
    pub fn inputs_of(simulation: &JobSpec) -> Inputs {
        let spec = DataSpec::of(simulation).unwrap();
        Inputs { data: vec![FoundData::unmade(simulation.digest(), spec)], ..Inputs::default() }
    }
}

use serde::{Deserialize, Serialize};
use spec::{SpecError, VerifySpec};
use store::{JobReuse, Need, NewTask, Output, PartReuse};

use crate::inputs::Inputs;
use crate::kind::{Kind, task};

/// One shard of a dataset that existed when the job was submitted. Other datasets may have the same
/// digest.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct VerifyTask {
    /// The index of the shard, from 0.
    pub shard: u32,
    /// The id of the dataset. `None` if the dataset is made by another job of the pipeline.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dataset: Option<i64>,
}

impl Kind for VerifySpec {
    fn unit(&self) -> &'static str {
        "trajectories"
    }

    fn tasks(&self, inputs: &Inputs) -> Result<Vec<NewTask>, SpecError> {
        let data = inputs.data()?;
        let dataset = data.this_dataset().map(|dataset| dataset.id.0);
        let shards = u32::try_from(data.spec.shard_count()).unwrap_or(u32::MAX);
        let shard = |shard: u32| {
            let total = data.spec.simulation().map_or(0, |spec| {
                let trajectories = spec.shard(u64::from(shard));
                trajectories.end - trajectories.start
            });
            let payload = VerifyTask { shard, dataset };
            task(0, shard, format!("shard {shard:05}"), &payload, total)
        };
        Ok((0..shards).map(shard).collect())
    }

    fn output(&self) -> Output {
        Output::Nothing
    }

    /// A verification is never reused, because its result is about the time when it ran.
    fn reuse(&self) -> JobReuse {
        JobReuse { whole: false, parts: PartReuse::Nothing }
    }

    /// A dataset that is named by its id is verified itself, and not another one with the same
    /// digest.
    fn needs(&self, inputs: &Inputs) -> Vec<Need> {
        let asked = inputs.data().ok().and_then(|data| data.asked.as_ref());
        asked.map_or_else(|| inputs.needs.clone(), |dataset| vec![Need::Existing(dataset.job)])
    }

    fn name(&self, inputs: &Inputs) -> Option<String> {
        let dataset = inputs.data().ok()?.this_dataset()?;
        Some(format!("verify-dataset-{}", dataset.id))
    }
}

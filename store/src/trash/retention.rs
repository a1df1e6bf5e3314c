//! Retention: what goes into the trash by itself, and how long logs are kept.

use std::collections::BTreeMap;
use std::time::Duration;

use serde_json::Value;
use spec::{Digest, TrainingStep};

use crate::boxed;
use crate::database::Scope;
use crate::trash::statements::trash::OldCheckpoint;
use crate::{CheckpointId, DeletionOrder, Item, JobId, Respect, Store, StoreError};

/// How long things are kept that nobody asked to be kept; for ever without a value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Retention {
    /// Jobs that failed or were cancelled, counted from their end. A pipeline counts only if none
    /// of its members succeeded.
    pub failed_jobs: Option<Duration>,
    /// How many of the newest checkpoints to keep per ended training.
    pub checkpoints: Option<u32>,
    /// Logs of jobs, since they ended.
    pub logs: Option<Duration>,
}

/// An item whose retention time is over.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outdated {
    /// The item to delete.
    pub item: Item,
    /// Its name for people.
    pub name: String,
    /// Why it need not be kept.
    pub reason: String,
}

/// Number of items moved in one pass. The next pass moves the rest.
const AT_ONCE: u32 = 500;

const MILLISECONDS_OF_A_DAY: u128 = 24 * 60 * 60 * 1000;

impl Store {
    /// The items that [`Store::retire`] would move into the trash.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn outdated(&self, retention: Retention) -> Result<Vec<Outdated>, StoreError> {
        let mut found = Vec::new();
        if let Some(age) = retention.failed_jobs {
            found.extend(self.outdated_jobs(age).await?);
        }
        if let Some(keep) = retention.checkpoints {
            found.extend(self.outdated_checkpoints(keep).await?);
        }
        Ok(found)
    }

    /// Moves items whose retention time is over into the trash, where they can be restored for
    /// `keep`. Items that jobs depend on stay. Returns the moved items.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn retire(
        &self,
        retention: Retention,
        keep: Duration,
    ) -> Result<Vec<Outdated>, StoreError> {
        let mut retired = Vec::new();
        for outdated in self.outdated(retention).await? {
            let reason = Some(outdated.reason.as_str());
            let respect = respect(outdated.item);
            match self.delete(outdated.item, &DeletionOrder { respect, keep, reason }).await {
                Ok(_) => retired.push(outdated),
                Err(error) if has_passed(&error) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(retired)
    }

    /// The jobs that ended longer than `age` ago and still have logs.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn outdated_logs(&self, age: Duration) -> Result<Vec<JobId>, StoreError> {
        self.read(RETIRING).jobs_with_old_logs(age, None).await
    }

    /// Deletes the logs of jobs that ended longer than `age` ago, for good. Returns how many jobs lost theirs.
    ///
    /// # Errors
    /// When the database fails. Logs that were deleted before the error stay deleted.
    #[boxed]
    pub async fn delete_old_logs(&self, age: Duration) -> Result<u64, StoreError> {
        let mut count = 0;
        loop {
            let jobs = self.read(RETIRING).jobs_with_old_logs(age, Some(AT_ONCE)).await?;
            if jobs.is_empty() {
                return Ok(count);
            }
            let mut tx = self.begin(Scope::Rows, "deleting old logs").await?;
            tx.delete_logs_of_jobs(&jobs).await?;
            tx.commit().await?;
            count += jobs.len() as u64;
        }
    }

    async fn outdated_jobs(&self, age: Duration) -> Result<Vec<Outdated>, StoreError> {
        let reason =
            format!("failed jobs are kept for {} days", age.as_millis() / MILLISECONDS_OF_A_DAY);
        let mut found = Vec::new();
        let mut after = JobId(0);
        loop {
            let page = self.read(RETIRING).failed_jobs(age, after, AT_ONCE).await?;
            let Some((last, _)) = page.last() else { return Ok(found) };
            after = *last;
            for (job, name) in page {
                let item = Item::from(job);
                if !self.is_free(item).await? {
                    continue;
                }
                found.push(Outdated { item, name, reason: reason.clone() });
                if found.len() >= AT_ONCE as usize {
                    return Ok(found);
                }
            }
        }
    }

    async fn outdated_checkpoints(&self, keep: u32) -> Result<Vec<Outdated>, StoreError> {
        let plural = if keep == 1 { "" } else { "s" };
        let reason = format!("a training keeps its {keep} newest checkpoint{plural} and the best");
        let mut found = Vec::new();
        let mut named: BTreeMap<String, Vec<u64>> = BTreeMap::new();
        let mut after = CheckpointId(0);
        loop {
            let page = self.read(RETIRING).old_checkpoints(keep, after, AT_ONCE).await?;
            let Some(last) = page.last() else { return Ok(found) };
            after = last.id;
            for OldCheckpoint { id, step, name, digest } in page {
                let key = digest.to_string();
                let steps = match named.get(&key) {
                    Some(steps) => steps,
                    None => {
                        let specs = self.read(RETIRING).specs_that_name(digest).await?;
                        let steps = specs.iter().flat_map(|spec| steps_named(spec, digest));
                        named.entry(key).or_insert(steps.collect())
                    }
                };
                let item = Item::from(id);
                if steps.contains(&step) || !self.is_free(item).await? {
                    continue;
                }
                found.push(Outdated { item, name, reason: reason.clone() });
                if found.len() >= AT_ONCE as usize {
                    return Ok(found);
                }
            }
        }
    }

    /// Whether no job depends on it that counts for its kind.
    async fn is_free(&self, item: Item) -> Result<bool, StoreError> {
        match self.dependents(item).await {
            Ok((_, dependents)) => Ok(match respect(item) {
                Respect::All => dependents.is_empty(),
                Respect::Open => dependents.iter().all(|dependent| dependent.state.is_final()),
            }),
            Err(error) if has_passed(&error) => Ok(false),
            Err(error) => Err(error),
        }
    }
}

const RETIRING: &str = "looking for what is kept no longer";

/// An ended job depends only on the checkpoint that it has read. That is the final one, the best
/// one, or one that its spec names by its step, and retention keeps all of these.
const fn respect(item: Item) -> Respect {
    match item.kind {
        wire::ItemKind::Checkpoint => Respect::Open,
        wire::ItemKind::Job | wire::ItemKind::Run | wire::ItemKind::Dataset => Respect::All,
    }
}

/// The steps of the training with this digest whose checkpoints a spec names.
fn steps_named(spec: &Value, training: Digest) -> Vec<u64> {
    let inner: Box<dyn Iterator<Item = &Value>> = match spec {
        Value::Object(fields) => Box::new(fields.values()),
        Value::Array(values) => Box::new(values.iter()),
        _ => return Vec::new(),
    };
    let own = serde_json::from_value::<TrainingStep>(spec.clone()).ok();
    let own = own.filter(|named| named.digest == training).map(|named| named.step);
    own.into_iter().chain(inner.flat_map(|value| steps_named(value, training))).collect()
}

/// Whether the item was deleted by somebody else, or a job began to depend on it.
fn has_passed(error: &StoreError) -> bool {
    matches!(
        error,
        StoreError::InTrash { .. }
            | StoreError::Purged { .. }
            | StoreError::NotFound { .. }
            | StoreError::Needed { .. }
            | StoreError::NotEnded { .. }
    )
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_step_is_named_wherever_it_stands_in_a_spec() {
        let (training, other) = (Digest::of(b"training"), Digest::of(b"other"));
        let spec = json!({
            "data": {"digest": training},
            "models": [
                {"checkpoint": {"step": {"digest": training, "step": 200}}},
                {"checkpoint": {"step": {"digest": other, "step": 300}}},
                {"checkpoint": {"best": {"digest": training}}},
            ],
            "then": {"from": {"step": {"digest": training, "step": 400}}},
        });
        assert_eq!(steps_named(&spec, training), [200, 400]);
    }
}

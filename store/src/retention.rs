//! Retention: things that are moved into the trash automatically.

use std::time::Duration;

use crate::boxed;
use crate::database::sql;
use crate::{DeletionOrder, Item, Respect, Store, StoreError};

/// How long things are kept that nobody asked to keep; `None` for ever.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Retention {
    /// Jobs that failed or were cancelled, counted from their end. A pipeline counts only if none
    /// of its members succeeded.
    pub failed_jobs: Option<Duration>,
}

/// An item whose retention time is over.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outdated {
    pub item: Item,
    pub name: String,
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
        let Some(age) = retention.failed_jobs else { return Ok(Vec::new()) };
        let reason = reason(age);
        let mut found = Vec::new();
        let jobs = sql!(self.database(), RETIRING, failed_jobs(age, AT_ONCE))?;
        for (job, name) in jobs {
            let item = Item::from(job);
            let is_free = match self.dependents(item).await {
                Ok((_, dependents)) => dependents.is_empty(),
                Err(error) if has_passed(&error) => false,
                Err(error) => return Err(error),
            };
            if is_free {
                found.push(Outdated { item, name, reason: reason.clone() });
            }
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
            let order = DeletionOrder { respect: Respect::All, keep, reason };
            match self.delete(outdated.item, &order).await {
                Ok(_) => retired.push(outdated),
                Err(error) if has_passed(&error) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(retired)
    }
}

const RETIRING: &str = "looking for what is kept no longer";

fn reason(age: Duration) -> String {
    format!("failed jobs are kept for {} days", age.as_millis() / MILLISECONDS_OF_A_DAY)
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

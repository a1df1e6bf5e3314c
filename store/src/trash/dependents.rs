//! The jobs that depend on the results of other jobs.

use spec::Digest;
use wire::{JobState, Relation};

use crate::database::{Transaction, sql};
use crate::trash::Reach;
use crate::{JobId, StoreError};

/// A job that depends on an item.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Dependent {
    pub job: JobId,
    /// The store does not interpret it.
    pub kind: String,
    pub name: String,
    pub state: JobState,
    pub relation: Relation,
    pub digest: Digest,
}

/// Dependents, sorted by job. A job that has ended counts as long as a result of it exists that was
/// made with the item.
pub(crate) async fn of(tx: &mut Transaction, reach: &Reach) -> Result<Vec<Dependent>, StoreError> {
    let mut found: Vec<Dependent> = sql!(&mut *tx, readers(reach))?;
    found.extend(sql!(&mut *tx, successors(reach))?);
    if reach.whole {
        found.extend(sql!(tx, holders(reach))?);
    }
    found.sort_by_key(|dependent| (dependent.job, dependent.relation));
    found.dedup_by_key(|dependent| dependent.job);
    Ok(found)
}

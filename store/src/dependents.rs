//! The jobs that depend on what other jobs left.

use spec::Digest;
use wire::{JobState, Relation};

use crate::database::{Transaction, sql};
use crate::trash::Reach;
use crate::{JobId, StoreError};

/// A job that depends on something.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Dependent {
    pub job: JobId,
    /// Opaque to the store.
    pub kind: String,
    pub name: String,
    pub state: JobState,
    pub relation: Relation,
    pub digest: Digest,
}

/// By job. Those that have ended count while something of theirs is there that was made with it.
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

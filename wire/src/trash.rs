//! Deletions, their dependents, and the trash.

use serde::{Deserialize, Serialize};
use spec::JobKind;
use utoipa::ToSchema;

use crate::{ItemKind, JobState, Relation};

/// A job, a run, a dataset or a checkpoint, by its id.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Item {
    pub kind: ItemKind,
    pub id: i64,
}

/// The things that a deletion also deletes, and the jobs that depend on it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Dependents {
    pub kind: ItemKind,
    pub id: i64,
    /// The things that it owns, which go into the trash with it.
    pub along: Vec<Item>,
    /// Size of all their files.
    pub bytes: u64,
    /// Jobs that read it, need it or go on from it. Those that have not ended prevent the deletion.
    pub jobs: Vec<Dependent>,
}

/// A job that depends on something.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Dependent {
    pub id: i64,
    pub kind: JobKind,
    pub name: String,
    pub state: JobState,
    pub relation: Relation,
}

/// The things moved into the trash, and until when they can be restored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Deleted {
    pub kind: ItemKind,
    pub id: i64,
    pub along: Vec<Item>,
    pub deleted_at: String,
    pub purge_at: String,
}

/// The things restored from the trash.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Restored {
    pub kind: ItemKind,
    pub id: i64,
    pub along: Vec<Item>,
}

/// A page of the trash, what was deleted last first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Trash {
    pub items: Vec<TrashedItem>,
    /// The `before` of the following page.
    pub next: Option<String>,
}

/// Something in the trash. What it took along is not listed by itself, and comes back with it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TrashedItem {
    pub kind: ItemKind,
    pub id: i64,
    /// Of its job.
    pub name: String,
    /// Size of its files, and of those that went with it.
    pub bytes: u64,
    pub deleted_at: String,
    /// From then on its bytes may be deleted for good.
    pub purge_at: String,
    /// Why it was deleted, if nobody asked for it.
    pub reason: Option<String>,
}

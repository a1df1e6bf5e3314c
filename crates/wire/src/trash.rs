//! Deletions, their dependents, and the trash.

use serde::{Deserialize, Serialize};
use spec::JobKind;
use utoipa::ToSchema;

use crate::{ItemKind, JobState, ListCell, ListColumn, Relation, Tabled};

/// A job, a run, a dataset or a checkpoint, named by its kind and id.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Item {
    /// Whether it is a job, a run, a dataset or a checkpoint.
    pub kind: ItemKind,
    /// Its id among those of its kind.
    pub id: i64,
}

/// The items that are deleted together with an item, and the jobs that depend on it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Dependents {
    /// The kind of the item.
    pub kind: ItemKind,
    /// Its id among those of its kind.
    pub id: i64,
    /// The items that it owns, which are deleted with it.
    pub along: Vec<Item>,
    /// Size of all their files together.
    pub bytes: u64,
    /// Jobs that read it, need it or continue from it. Jobs that have not ended prevent the
    /// deletion.
    pub jobs: Vec<Dependent>,
}

/// A job that depends on an item.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Dependent {
    /// The id of the job.
    pub id: i64,
    /// The kind of the job.
    pub kind: JobKind,
    /// The name of the job.
    pub name: String,
    /// The state of the job.
    pub state: JobState,
    /// How it depends on the item.
    pub relation: Relation,
}

/// The items that were moved into the trash, and the time until which they can be restored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Deleted {
    /// The kind of the deleted item.
    pub kind: ItemKind,
    /// Its id among those of its kind.
    pub id: i64,
    /// The items that were deleted with it, because it owns them.
    pub along: Vec<Item>,
    /// When it was moved into the trash.
    pub deleted_at: String,
    /// After this time its bytes may be deleted permanently.
    pub purge_at: String,
}

/// The items that were restored from the trash.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Restored {
    /// The kind of the restored item.
    pub kind: ItemKind,
    /// Its id among those of its kind.
    pub id: i64,
    /// The items that were restored with it.
    pub along: Vec<Item>,
}

/// A page of the trash, latest deletion first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Trash {
    /// The items of the page.
    pub items: Vec<TrashedItem>,
    /// The `before` of the following page.
    pub next: Option<String>,
}

/// An item in the trash. Items that were deleted with it are not listed, and are restored with it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TrashedItem {
    /// The kind of the item.
    pub kind: ItemKind,
    /// Its id among those of its kind.
    pub id: i64,
    /// The name by which people know it: one that they gave it, or that of its job.
    pub name: String,
    /// The name that people gave the result of a job, which was deleted with it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub result_name: Option<String>,
    /// Size of its files and of the files of items that were deleted with it.
    pub bytes: u64,
    /// When it was moved into the trash.
    pub deleted_at: String,
    /// After this time its bytes may be deleted permanently.
    pub purge_at: String,
    /// The reason, if it was deleted automatically.
    pub reason: Option<String>,
}

impl Tabled for TrashedItem {
    const COLUMNS: &'static [ListColumn<Self>] = &[
        ListColumn::words("kind", |item| ListCell::text(item.kind)),
        ListColumn::number("id", |item| ListCell::text(item.id)),
        ListColumn::words("name", |item| match &item.result_name {
            Some(result) => ListCell::text(format!("{}, with {result}", item.name)),
            None => ListCell::text(&item.name),
        }),
        ListColumn::number("size", |item| ListCell::Bytes(item.bytes)),
        ListColumn::number("deleted", |item| ListCell::moment(&item.deleted_at)),
        ListColumn::words("kept until", |item| ListCell::text(&item.purge_at)),
        ListColumn::words("why", |item| ListCell::some(item.reason.as_ref(), ListCell::text)),
    ];
}

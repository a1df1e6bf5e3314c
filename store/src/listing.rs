//! Lists of jobs, runs, datasets and checkpoints: filtered, sorted, and read page by page from where the page before ended.

use serde::{Deserialize, Serialize};

use crate::boxed;
use crate::database::sql;
use crate::labels::folded;
use crate::{
    Checkpoint, CheckpointId, Dataset, DatasetId, Job, JobId, Page, Run, RunId, Store, StoreError,
    Thing, Timestamp,
};

/// A query of a list. A missing filter lets everything through, and an item must match all others.
#[derive(Clone, Debug)]
pub struct Listing {
    /// The job's.
    pub kind: Option<String>,
    pub state: Option<String>,
    /// Each of them is a tag of the thing, or of its job.
    pub tags: Vec<String>,
    /// Part of the name or the note of the thing or of its job, in upper or lower case.
    pub text: Option<String>,
    /// Made at this moment or after.
    pub since: Option<Timestamp>,
    /// Made before this moment.
    pub until: Option<Timestamp>,
    /// With a smaller id.
    pub before: Option<i64>,
    /// Jobs that somebody asked for: pipelines, and jobs that were not made for one.
    pub experiments_alone: bool,
    pub sort: Sort,
    pub direction: Direction,
    /// Behind this place of the list, where the page before ended.
    pub after: Option<Position>,
    /// At most 500.
    pub limit: u32,
}

impl Default for Listing {
    /// The newest 50.
    fn default() -> Self {
        Self {
            kind: None,
            state: None,
            tags: Vec::new(),
            text: None,
            since: None,
            until: None,
            before: None,
            experiments_alone: false,
            sort: Sort::Created,
            direction: Direction::Descending,
            after: None,
            limit: 50,
        }
    }
}

impl From<Page> for Listing {
    fn from(page: Page) -> Self {
        Self { before: page.before, limit: page.limit, ..Self::default() }
    }
}

impl Listing {
    pub(crate) fn limit(&self) -> u32 {
        self.limit.min(Page::MAX_LIMIT)
    }

    /// As names and notes are kept to be looked through.
    pub(crate) fn words(&self) -> Option<String> {
        self.text.as_deref().map(folded)
    }
}

/// The sort key of a list. Rows with equal keys are in the order of their ids.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sort {
    /// The order in which things were made, which is that of their ids.
    Created,
    /// The moment at which the job ended. What has not ended comes after all that has.
    Finished,
    /// By bytes.
    Name,
    Priority,
    Trajectories,
    Step,
}

impl Sort {
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Created => "created",
            Self::Finished => "finished",
            Self::Name => "name",
            Self::Priority => "priority",
            Self::Trajectories => "trajectories",
            Self::Step => "step",
        }
    }

    /// The orders that a list of such things has.
    pub const fn of(thing: Thing) -> &'static [Self] {
        match thing {
            Thing::Job => &[Self::Created, Self::Finished, Self::Name, Self::Priority],
            Thing::Run => &[Self::Created, Self::Finished, Self::Name],
            Thing::Dataset => &[Self::Created, Self::Name, Self::Trajectories],
            Thing::Checkpoint => &[Self::Created, Self::Step],
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    Ascending,
    Descending,
}

/// The place of a row in a list: by what the list is sorted, and then by its id.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Position {
    pub key: Key,
    pub id: i64,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Key {
    Integer(i64),
    Text(String),
}

/// A page of a list.
#[derive(Clone, Debug)]
pub struct Listed<T> {
    pub items: Vec<T>,
    /// Where it ends; `None` on the last page.
    pub end: Option<Position>,
}

/// The places of a page, in order, and where it ends.
struct Found {
    ids: Vec<i64>,
    end: Option<Position>,
}

impl Found {
    /// The rows of these places, in their order. One that was deleted meanwhile is left out.
    fn with<T>(self, mut rows: Vec<T>, id: impl Fn(&T) -> i64) -> Listed<T> {
        let place = |row: &T| self.ids.iter().position(|found| *found == id(row));
        rows.sort_by_cached_key(place);
        Listed { items: rows, end: self.end }
    }
}

impl Store {
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn list_jobs(&self, listing: &Listing) -> Result<Listed<Job>, StoreError> {
        let found = self.found(Thing::Job, listing).await?;
        let ids: Vec<JobId> = found.ids.iter().copied().map(JobId).collect();
        let rows = self.jobs_by_id(&ids).await?;
        Ok(found.with(rows, |job| job.id.0))
    }

    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn list_runs(&self, listing: &Listing) -> Result<Listed<Run>, StoreError> {
        let found = self.found(Thing::Run, listing).await?;
        let ids: Vec<RunId> = found.ids.iter().copied().map(RunId).collect();
        let rows = sql!(self.database(), LISTING, runs_by_id(&ids))?;
        Ok(found.with(rows, |run| run.id.0))
    }

    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn list_datasets(&self, listing: &Listing) -> Result<Listed<Dataset>, StoreError> {
        let found = self.found(Thing::Dataset, listing).await?;
        let ids: Vec<DatasetId> = found.ids.iter().copied().map(DatasetId).collect();
        let rows = self.datasets_by_id(&ids).await?;
        Ok(found.with(rows, |dataset| dataset.id.0))
    }

    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn list_checkpoints(
        &self,
        listing: &Listing,
    ) -> Result<Listed<Checkpoint>, StoreError> {
        let found = self.found(Thing::Checkpoint, listing).await?;
        let ids: Vec<CheckpointId> = found.ids.iter().copied().map(CheckpointId).collect();
        let rows = sql!(self.database(), LISTING, checkpoints_by_id(&ids))?;
        Ok(found.with(rows, |checkpoint| checkpoint.id.0))
    }

    /// Finds the rows of a page before anything large of them is read.
    async fn found(&self, thing: Thing, listing: &Listing) -> Result<Found, StoreError> {
        let mut places = sql!(self.database(), LISTING, places(thing, listing))?;
        let limit = usize::try_from(listing.limit()).unwrap_or(usize::MAX);
        // One more than is shown tells whether there is another page.
        let has_more = places.len() > limit;
        places.truncate(limit);
        let end = places.last().filter(|_| has_more).cloned();
        Ok(Found { ids: places.iter().map(|place| place.id).collect(), end })
    }
}

const LISTING: &str = "reading a list";

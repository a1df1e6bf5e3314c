//! Lists of jobs, runs, datasets, checkpoints and robots. They are filtered, sorted, and read page by page;
//! each page begins where the one before ended.
//!
//! A list is read in two statements. The first finds ids in their order, by filters and by the
//! place of the previous page's last row, and reads nothing large. The second reads those rows.
//! Names and notes are folded to lower case in Rust, because databases and locales disagree about
//! letters, and text is searched in the folded form.

use serde::{Deserialize, Serialize};
use wire::Sort;

use crate::lists::labels::folded;
use crate::{DatasetId, ItemKind, Page, Store, StoreError, Timestamp};

/// The query of a list. An item must match every filter that is set.
#[derive(Clone, Debug)]
pub struct Listing {
    /// The job's kind.
    pub kind: Option<String>,
    /// The state of the item, or of its job, in the words of the API.
    pub state: Option<String>,
    /// The item or its job must have each of these tags; a checkpoint may have it as an alias.
    pub tags: Vec<String>,
    /// Part of the name or the note of the item or of its job, ignoring case.
    pub text: Option<String>,
    /// The job must read this dataset.
    pub data: Option<DatasetId>,
    /// Created at this moment or later.
    pub since: Option<Timestamp>,
    /// Created before this moment.
    pub until: Option<Timestamp>,
    /// Ids below this one.
    pub before: Option<i64>,
    /// Only jobs that somebody asked for: pipelines, and jobs that do not belong to one.
    pub experiments_alone: bool,
    /// The sort key.
    pub sort: Sort,
    /// Which end comes first.
    pub direction: Direction,
    /// Items after this position. Pass the end of the page before.
    pub after: Option<Position>,
    /// Number of items, 500 at most.
    pub limit: u32,
}

impl Default for Listing {
    /// Lists the newest 50.
    fn default() -> Self {
        Self {
            kind: None,
            state: None,
            tags: Vec::new(),
            text: None,
            data: None,
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

    /// The search text, in the form in which names and notes are stored for the search.
    pub(crate) fn words(&self) -> Option<String> {
        self.text.as_deref().map(folded)
    }
}

/// The order of a list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// Small values first.
    Ascending,
    /// Large values first.
    Descending,
}

/// The position of a row in a list: its sort key, and then its id.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Position {
    /// The item's sort key.
    pub key: Key,
    /// The item's id, which decides between equal keys.
    pub id: i64,
}

/// The value of a sort key.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Key {
    /// A count, a moment in milliseconds, or an id.
    Integer(i64),
    /// A measure.
    Number(f64),
    /// A name.
    Text(String),
}

/// A page of a list.
#[derive(Clone, Debug)]
pub struct Listed<T> {
    /// The items of the page, in order.
    pub items: Vec<T>,
    /// The position at which the next page begins; `None` on the last page.
    pub end: Option<Position>,
}

/// The positions of the rows of a page, in order, and the page's end.
pub(crate) struct FoundRows {
    pub ids: Vec<i64>,
    end: Option<Position>,
}

impl FoundRows {
    /// The rows at these positions, in the same order. A row that was deleted meanwhile is left
    /// out.
    pub fn with<T>(self, mut rows: Vec<T>, id: impl Fn(&T) -> i64) -> Listed<T> {
        let place = |row: &T| self.ids.iter().position(|found| *found == id(row));
        rows.sort_by_cached_key(place);
        Listed { items: rows, end: self.end }
    }
}

impl Store {
    /// Finds the ids of a page before any large column is read.
    pub(crate) async fn found(
        &self,
        item: ItemKind,
        listing: &Listing,
    ) -> Result<FoundRows, StoreError> {
        let places = self.read(LISTING).places(item, listing).await?;
        Ok(FoundRows::of(places, listing))
    }
}

impl FoundRows {
    /// The places of a page, without the row behind it.
    pub fn of(mut places: Vec<Position>, listing: &Listing) -> Self {
        let limit = usize::try_from(listing.limit()).unwrap_or(usize::MAX);
        // One row more than the limit tells whether there is another page.
        let has_more = places.len() > limit;
        places.truncate(limit);
        let end = places.last().filter(|_| has_more).cloned();
        Self { ids: places.iter().map(|place| place.id).collect(), end }
    }
}

pub(crate) const LISTING: &str = "reading a list";

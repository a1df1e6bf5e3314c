//! The declaration of lists and tables. Each resource declares its list beside its type. The API, its
//! document, the page and the command line follow the declaration.

use std::fmt::Display;

use serde::de::DeserializeOwned;
use serde_json::Value;
use spec::JobKind;

use crate::{Headline, JobState, Sort};

/// Items that tables show.
pub trait Tabled: Sized + 'static {
    /// The columns of the page and of the command line.
    const COLUMNS: &'static [ListColumn<Self>];
}

/// A resource with a list. Its [`Tabled::COLUMNS`] come between the name and the tags.
pub trait Listed: Tabled {
    /// The list's name, filters and orders.
    const LIST: List;

    /// The answer of the API to a request for a page.
    type Page: ListPage<Item = Self>;

    /// The id, which is the first column.
    fn id(&self) -> i64;

    /// The name; empty if it has none.
    fn name(&self) -> &str;

    /// Its own tags, then those of its job.
    fn tags(&self) -> Vec<&str>;

    /// Its cell in a column that a reader chose: the last value of a metric, or a field of the spec by its path, such as
    /// `optimizer.learning_rate`.
    fn chosen(&self, _column: &str) -> ListCell {
        ListCell::Missing
    }
}

/// A page of a list.
pub trait ListPage: DeserializeOwned {
    /// The resource.
    type Item;

    /// A page of `items`. `next` is the `cursor` of the following page; `None` on the last one.
    fn new(items: Vec<Self::Item>, next: Option<String>) -> Self;

    /// The items, and the `cursor` of the following page.
    fn into_parts(self) -> (Vec<Self::Item>, Option<String>);
}

/// The list of a resource: its name, its filters and its orders. Every list can also be filtered by
/// text and time.
#[derive(Debug)]
pub struct List {
    /// The name in paths, e.g. `runs`.
    pub name: &'static str,
    /// Where its items come from, for a page without any.
    pub empty: &'static str,
    /// The kinds of jobs that it can be filtered by. Empty if all items are of the same kind.
    pub kinds: &'static [&'static str],
    /// Restricts the list to jobs of this kind.
    pub only: Option<JobKind>,
    /// The states that it can be filtered by. Empty if items have no state.
    pub states: &'static [&'static str],
    /// The keys that it can be sorted by. The database's expressions for them are in the store's
    /// statements for lists.
    pub sorts: &'static [Sort],
    /// Whether items have tags, which the list can be filtered by, and notes.
    pub has_labels: bool,
    /// Whether tables can have columns that their reader chooses, see [`Listed::chosen`].
    pub has_columns: bool,
}

/// A column of a table.
#[derive(Debug)]
pub struct ListColumn<T> {
    /// Its name on the page and in the terminal.
    pub heading: &'static str,
    /// Whether its cells are numbers, which are aligned at the right edge.
    pub is_number: bool,
    /// Its content for an item.
    pub cell: fn(&T) -> ListCell,
}

/// The content of a cell. The page and the command line choose its form.
#[derive(Clone, Debug, PartialEq)]
pub enum ListCell {
    /// There is no value.
    Missing,
    /// Words.
    Text(String),
    /// The word of a state, with the state of a job by which it is coloured.
    State(JobState, &'static str),
    /// A whole number of things.
    Count(u64),
    /// A size.
    Bytes(u64),
    /// An angle in degrees.
    Degrees(f64),
    /// Any other number.
    Number(f64),
    /// The best predictors of an evaluation.
    Headline(Headline),
    /// A part of 100.
    Percent(f64),
    /// The done part of a whole number.
    Part(u64, u64),
    /// A time in RFC 3339.
    Moment(String),
    /// The time from one moment to another, or to now.
    Span(String, Option<String>),
}

impl List {
    /// The allowed orders: each key in both directions.
    pub fn orders(&self) -> Vec<String> {
        let both = |sort: &Sort| [sort.to_string(), format!("-{sort}")];
        self.sorts.iter().flat_map(both).collect()
    }
}

impl<T> ListColumn<T> {
    /// A column aligned at the left edge.
    pub const fn words(heading: &'static str, cell: fn(&T) -> ListCell) -> Self {
        Self { heading, is_number: false, cell }
    }

    /// A column aligned at the right edge.
    pub const fn number(heading: &'static str, cell: fn(&T) -> ListCell) -> Self {
        Self { heading, is_number: true, cell }
    }
}

impl ListCell {
    /// Words from anything that displays itself.
    pub fn text(text: impl Display) -> Self {
        Self::Text(text.to_string())
    }

    /// The word and the colour of a job's state.
    pub fn state(state: JobState) -> Self {
        Self::State(state, state.as_str())
    }

    /// The value at a path of a spec, such as `optimizer.learning_rate`.
    pub fn at(spec: &Value, path: &str) -> Self {
        let found = path.split('.').try_fold(spec, |value, field| value.get(field));
        match found {
            None | Some(Value::Null) => Self::Missing,
            Some(Value::String(text)) => Self::text(text),
            Some(value) => value.as_f64().map_or_else(|| Self::text(value), Self::Number),
        }
    }

    /// A time in RFC 3339.
    pub fn moment(time: &str) -> Self {
        Self::Moment(time.to_owned())
    }

    /// The done part of a whole number; missing if there is nothing to do.
    pub fn part(done: u64, all: u64) -> Self {
        if all == 0 { Self::Missing } else { Self::Part(done, all) }
    }

    /// The time from a moment, if there is one, to another or to now.
    pub fn span(from: Option<&String>, to: Option<&String>) -> Self {
        Self::some(from, |from| Self::Span(from.clone(), to.cloned()))
    }

    /// A cell that is missing without a value.
    pub fn some<V>(value: Option<V>, cell: impl FnOnce(V) -> Self) -> Self {
        value.map_or(Self::Missing, cell)
    }
}

/// The tags of an item, then those of its job that it does not have itself.
pub(crate) fn all_tags<'a>(own: &'a [String], job: &'a [String]) -> Vec<&'a str> {
    let others = job.iter().filter(|tag| !own.contains(tag));
    own.iter().chain(others).map(String::as_str).collect()
}

/// Declares the pages of lists. The field with the items has the list's name.
macro_rules! list_pages {
    ($($(#[$about:meta])* $Page:ident { $items:ident: $Item:ident },)+) => {$(
        $(#[$about])*
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize, utoipa::ToSchema)]
        pub struct $Page {
            /// The items of the page.
            pub $items: Vec<crate::$Item>,
            /// The `cursor` of the following page; `null` on the last one.
            pub next: Option<String>,
        }

        impl ListPage for $Page {
            type Item = crate::$Item;

            fn new($items: Vec<Self::Item>, next: Option<String>) -> Self {
                Self { $items, next }
            }

            fn into_parts(self) -> (Vec<Self::Item>, Option<String>) {
                (self.$items, self.next)
            }
        }
    )+};
}

list_pages! {
    /// A page of jobs.
    Jobs { jobs: Job },
    /// A page of runs.
    Runs { runs: Run },
    /// A page of datasets.
    Datasets { datasets: Dataset },
    /// A page of checkpoints.
    Checkpoints { checkpoints: Checkpoint },
    /// A page of evaluations.
    Evaluations { evaluations: Evaluation },
    /// A page of robots.
    Robots { robots: Robot },
}

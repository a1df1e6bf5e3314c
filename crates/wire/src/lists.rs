//! The declaration of lists. Each resource declares its list beside its type. The API, its
//! document, the page and the command line follow the declaration.

use spec::JobKind;

use crate::Sort;

/// A resource with a list.
pub trait Listed {
    const LIST: List;
}

/// The list of a resource: its name, its filters and its orders. Every list can also be filtered by
/// tags, text and time.
#[derive(Debug)]
pub struct List {
    /// The name in paths, e.g. `runs`.
    pub name: &'static str,
    /// The kinds of jobs that it can be filtered by. Empty if all items are of the same kind.
    pub kinds: &'static [&'static str],
    /// Restricts the list to jobs of this kind.
    pub only: Option<JobKind>,
    /// The states that it can be filtered by. Empty if items have no state.
    pub states: &'static [&'static str],
    /// The keys that it can be sorted by. The database's expressions for them are in the store's
    /// statements for lists.
    pub sorts: &'static [Sort],
}

impl List {
    /// The allowed orders: each key in both directions.
    pub fn orders(&self) -> Vec<String> {
        let both = |sort: &Sort| [sort.to_string(), format!("-{sort}")];
        self.sorts.iter().flat_map(both).collect()
    }
}

//! The query of a form that filters a list.

use wire::{List, Sort};

use crate::extract::QueryPairs;

/// A link to a list in another order.
pub struct Order {
    pub href: String,
    pub label: &'static str,
    /// The direction of the present order; empty for other orders.
    pub mark: &'static str,
}

/// The query of the form at `path`, without its empty fields.
pub struct FilterQuery {
    path: String,
    pairs: Vec<(String, String)>,
}

impl FilterQuery {
    pub fn new(path: String, pairs: QueryPairs) -> Self {
        Self { path, pairs: pairs.filled() }
    }

    pub fn pairs(&self) -> &[(String, String)] {
        &self.pairs
    }

    /// Whether anything but the order and the page is asked for.
    pub fn is_filtered(&self) -> bool {
        self.pairs.iter().any(|(name, _)| !["sort", "cursor", "columns"].contains(&name.as_str()))
    }

    /// The order that is asked for; empty if none is.
    pub fn order(&self) -> String {
        self.value("sort")
    }

    /// A link for each order of a list. A link to the present order reverses it.
    pub fn orders(&self, list: &List) -> Vec<Order> {
        let present = match self.order() {
            order if order.is_empty() => "-created".to_owned(),
            order => order,
        };
        let order = |sort: &Sort| {
            let word = sort.as_str();
            let (first, other) = match sort {
                // The largest, latest or most important first, but the smallest error.
                Sort::Name | Sort::Rmse => (word.to_owned(), format!("-{word}")),
                _ => (format!("-{word}"), word.to_owned()),
            };
            let mark = match present.strip_prefix('-') {
                None if present == word => "\u{2191}",
                Some(name) if name == word => "\u{2193}",
                _ => "",
            };
            let next = if present == first { other } else { first };
            Order { href: self.with("sort", Some(&next)), label: sort.title(), mark }
        };
        list.sorts.iter().map(order).collect()
    }

    /// The values of a parameter, in one text.
    pub fn value(&self, name: &str) -> String {
        let values = self.pairs.iter().filter(|(known, _)| known == name);
        values.map(|(_, value)| value.as_str()).collect::<Vec<_>>().join(" ")
    }

    /// The address of the same with another value for a parameter, or without it. It begins with the first page.
    pub fn with(&self, name: &str, value: Option<&str>) -> String {
        let keeps = |known: &&(String, String)| known.0 != name && known.0 != "cursor";
        let mut query = form_urlencoded::Serializer::new(String::new());
        query.extend_pairs(self.pairs.iter().filter(keeps));
        query.extend_pairs(value.map(|value| (name, value)));
        match query.finish() {
            query if query.is_empty() => self.path.clone(),
            query => format!("{}?{query}", self.path),
        }
    }
}

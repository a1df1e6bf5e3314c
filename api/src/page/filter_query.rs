//! The query of a form that filters a list.

use crate::extract::QueryPairs;

/// The query of the form at `path`, without its empty fields.
pub struct FilterQuery {
    path: &'static str,
    pairs: Vec<(String, String)>,
}

impl FilterQuery {
    pub fn new(path: &'static str, pairs: QueryPairs) -> Self {
        Self { path, pairs: pairs.filled() }
    }

    pub fn pairs(&self) -> &[(String, String)] {
        &self.pairs
    }

    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
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
            query if query.is_empty() => self.path.to_owned(),
            query => format!("{}?{query}", self.path),
        }
    }
}

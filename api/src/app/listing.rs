//! The parameters of lists: filters, an order and a page, the same for all lists.

use std::collections::BTreeSet;

use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use spec::Moment;
use store::{DatasetId, Direction, Key, Position, Timestamp};
use wire::{List, Sort};

use crate::app::labels;
use crate::app::paging;
use crate::error::ApiError;
use crate::limits::{PAGE_BYTES, SEARCH_CHARACTERS, TAGS};

/// A request for a page of a list.
#[derive(Debug)]
pub struct ListRequest {
    list: &'static str,
    pub listing: store::Listing,
}

/// The position at which a page begins. It is valid for one list in one order.
#[derive(Serialize, Deserialize)]
struct Cursor {
    list: String,
    sort: String,
    after: Position,
}

impl ListRequest {
    /// Reads the list parameters of a query, and ignores others.
    ///
    /// # Errors
    /// [`ApiError::Parameter`] for the first invalid one.
    pub fn read(list: &'static List, parameters: &[(String, String)]) -> Result<Self, ApiError> {
        let mut listing = store::Listing {
            kind: list.only.map(|kind| kind.as_str().to_owned()),
            limit: paging::checked(None)?,
            ..store::Listing::default()
        };
        let (mut seen, mut cursor) = (BTreeSet::new(), None);
        for (name, value) in parameters {
            let (name, value) = (name.as_str(), value.as_str());
            if name != "tag" && !seen.insert(name) {
                return Err(ApiError::parameter(name, value, "given once"));
            }
            match name {
                "limit" => listing.limit = limit(value)?,
                "before" => listing.before = Some(id(name, value, "an id, a whole number")?),
                "dataset" if has_errors(list) => {
                    listing.data = Some(DatasetId(id(name, value, "the id of a dataset")?));
                }
                "kind" => listing.kind = Some(one_of(name, value, list.kinds)?),
                "state" => listing.state = Some(one_of(name, value, list.states)?),
                "tag" => listing.tags.push(tag(value)?),
                "text" => listing.text = Some(text(value)?),
                "since" => listing.since = Some(moment(name, value)?),
                "until" => listing.until = Some(moment(name, value)?),
                "sort" => (listing.sort, listing.direction) = order(list, value)?,
                "cursor" => cursor = Some(value),
                _ => {}
            }
        }
        if listing.tags.len() > TAGS {
            let found = format!("given {} times", listing.tags.len());
            return Err(ApiError::parameter("tag", found, format!("given {TAGS} times at most")));
        }
        let mut request = Self { list: list.name, listing };
        request.listing.after = cursor.map(|cursor| request.place(cursor)).transpose()?;
        Ok(request)
    }

    /// A shorter page, if the items of this one, which have these `specs`, have more than
    /// [`PAGE_BYTES`]. It has one item at least.
    pub fn shorter<'a>(&self, specs: impl Iterator<Item = &'a Value>) -> Option<store::Listing> {
        let mut bytes = 0;
        let is_full = |spec: &Value| {
            bytes += paging::json_bytes(spec);
            bytes > PAGE_BYTES
        };
        let fitting = specs.map(is_full).position(|is_full| is_full)?.max(1);
        let limit = u32::try_from(fitting).ok().filter(|limit| *limit < self.listing.limit)?;
        Some(store::Listing { limit, ..self.listing.clone() })
    }

    /// The cursor of the page after one that ends at `end`.
    pub fn next(&self, end: Option<Position>) -> Option<String> {
        let cursor = Cursor { list: self.list.to_owned(), sort: self.sort(), after: end? };
        // It has only strings and numbers, so this cannot fail.
        serde_json::to_vec(&cursor).ok().map(|json| URL_SAFE_NO_PAD.encode(json))
    }

    fn place(&self, cursor: &str) -> Result<Position, ApiError> {
        let refused = |allowed: String| Err(ApiError::parameter("cursor", cursor, allowed));
        let json = URL_SAFE_NO_PAD.decode(cursor).unwrap_or_default();
        let Ok(Cursor { list, sort, after }) = serde_json::from_slice(&json) else {
            return refused("the next of a page before, or left out".to_owned());
        };
        if list != self.list {
            return refused(format!("the next of a page of {}; this one is of {list}", self.list));
        }
        if sort != self.sort() {
            let found = self.sort();
            return refused(format!(
                "the next of a page with sort={found}; this one had sort={sort}"
            ));
        }
        let is_key = match &after.key {
            // No name contains NUL, and PostgreSQL does not accept it.
            Key::Text(name) => self.listing.sort == Sort::Name && !name.contains('\0'),
            Key::Number(_) => self.listing.sort == Sort::Rmse,
            Key::Integer(_) => !matches!(self.listing.sort, Sort::Name | Sort::Rmse),
        };
        if !is_key {
            return refused("the next of a page before, or left out".to_owned());
        }
        Ok(after)
    }

    fn sort(&self) -> String {
        let sign = match self.listing.direction {
            Direction::Ascending => "",
            Direction::Descending => "-",
        };
        format!("{sign}{}", self.listing.sort.as_str())
    }
}

fn limit(value: &str) -> Result<u32, ApiError> {
    // Text that is not a number counts as out of range.
    let limit = value.parse().unwrap_or(0);
    paging::checked(Some(limit)).map_err(|_| paging::limit_error(value))
}

/// Whether the items of a list have errors on data, by which it can be sorted. Only such a list can
/// be filtered by data.
pub fn has_errors(list: &List) -> bool {
    list.sorts.contains(&Sort::Rmse)
}

fn id(name: &str, value: &str, allowed: &str) -> Result<i64, ApiError> {
    value.parse().map_err(|_| ApiError::parameter(name, value, allowed))
}

fn one_of(name: &str, value: &str, allowed: &[&'static str]) -> Result<String, ApiError> {
    if allowed.contains(&value) {
        return Ok(value.to_owned());
    }
    Err(ApiError::parameter(name, value, allowed.join(", ")))
}

fn tag(value: &str) -> Result<String, ApiError> {
    if labels::is_tag(value) {
        return Ok(value.to_owned());
    }
    Err(ApiError::parameter("tag", value, labels::TAG))
}

fn text(value: &str) -> Result<String, ApiError> {
    if labels::is_line(value, SEARCH_CHARACTERS) {
        return Ok(value.to_owned());
    }
    let allowed = format!("1 to {SEARCH_CHARACTERS} characters in one line");
    Err(ApiError::parameter("text", value, allowed))
}

fn moment(name: &str, value: &str) -> Result<Timestamp, ApiError> {
    let moment: Result<Moment, _> = value.parse();
    let allowed =
        "a moment with its zone, such as 2026-12-01T08:00:00Z or 2026-12-01T09:00:00%2B01:00";
    moment
        .map(|moment| Timestamp::from_milliseconds(moment.milliseconds()))
        .map_err(|_| ApiError::parameter(name, value, allowed))
}

fn order(list: &List, value: &str) -> Result<(Sort, Direction), ApiError> {
    let (name, direction) = match value.strip_prefix('-') {
        Some(name) => (name, Direction::Descending),
        None => (value, Direction::Ascending),
    };
    let known = list.sorts.iter().find(|sort| sort.as_str() == name);
    let refused = || ApiError::parameter("sort", value, list.orders().join(", "));
    known.map(|sort| (*sort, direction)).ok_or_else(refused)
}

#[cfg(test)]
mod tests {
    use wire::{Checkpoint, Dataset, Job, Listed, Run};

    use super::*;

    static JOBS: List = Job::LIST;
    static RUNS: List = Run::LIST;
    static DATASETS: List = Dataset::LIST;
    static CHECKPOINTS: List = Checkpoint::LIST;

    fn read(list: &'static List, query: &[(&str, &str)]) -> Result<ListRequest, String> {
        let own = |(name, value): &(&str, &str)| ((*name).to_owned(), (*value).to_owned());
        let query: Vec<(String, String)> = query.iter().map(own).collect();
        ListRequest::read(list, &query).map_err(|error| error.to_string())
    }

    #[test]
    fn a_cursor_belongs_to_one_list_in_one_order() {
        let names = read(&JOBS, &[("sort", "name")]).unwrap();
        let place = Position { key: Key::Text("ä \"b\"".to_owned()), id: 7 };
        let cursor = names.next(Some(place.clone())).unwrap();
        assert_eq!(names.next(None), None);
        let again = read(&JOBS, &[("cursor", &cursor), ("sort", "name"), ("kind", "train")]);
        assert_eq!(again.unwrap().listing.after, Some(place));
        let refused = |list, sort| read(list, &[("cursor", &cursor), ("sort", sort)]).unwrap_err();
        let error = refused(&JOBS, "-name");
        assert!(error.ends_with("with sort=-name; this one had sort=name"), "{error}");
        let error = refused(&RUNS, "name");
        assert!(error.ends_with("of a page of runs; this one is of jobs"), "{error}");
        for broken in ["", "7", &cursor[1..], "e30", "!"] {
            let error = read(&JOBS, &[("cursor", broken)]).unwrap_err();
            assert!(error.ends_with("allowed: the next of a page before, or left out"), "{error}");
        }
        for key in ["7", "7.5", r#""\u0000""#] {
            let json = format!(
                r#"{{"list": "jobs", "sort": "name", "after": {{"key": {key}, "id": 7}}}}"#
            );
            let made_up = URL_SAFE_NO_PAD.encode(json);
            assert!(read(&JOBS, &[("cursor", &made_up), ("sort", "name")]).is_err(), "{key}");
        }
    }

    #[test]
    fn every_parameter_says_what_is_allowed() {
        for (list, name, value, allowed) in [
            (&JOBS, "limit", "501", "1 to 500"),
            (&JOBS, "limit", "ten", "1 to 500"),
            (&JOBS, "before", "x", "an id, a whole number"),
            (&RUNS, "dataset", "test-grid", "the id of a dataset"),
            (&JOBS, "kind", "trian", "simulate, train"),
            (&DATASETS, "state", "queued", "building, complete, abandoned"),
            (&RUNS, "tag", "a b", labels::TAG),
            (&RUNS, "text", "a\nb", "1 to 200 characters in one line"),
            (&RUNS, "since", "yesterday", "a moment with its zone"),
            (&CHECKPOINTS, "sort", "name", "created, -created, step, -step, rmse, -rmse"),
        ] {
            let error = read(list, &[(name, value)]).unwrap_err();
            assert!(error.starts_with(&format!("{name} is {value:?}, allowed: ")), "{error}");
            assert!(error.contains(allowed), "{error}");
        }
        let twice = read(&JOBS, &[("text", "a"), ("text", "b")]).unwrap_err();
        assert_eq!(twice, "text is \"b\", allowed: given once");
        let many = [("tag", "a"); TAGS + 1];
        assert!(read(&JOBS, &many[..TAGS]).is_ok());
        assert!(read(&JOBS, &many).unwrap_err().contains("given 33 times"));
    }
}

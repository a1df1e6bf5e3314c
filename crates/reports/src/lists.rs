//! Lists of resources as CSV, for spreadsheets and notebooks, and what readers of lists should know.

use std::collections::BTreeSet;

use wire::{ListCell, Listed, Sort};

use crate::headline;

/// The items of a list as CSV: id, name, the columns of the list, those that a reader `chose`, and
/// tags. Numbers are plain, moments as RFC 3339, and a span of time is `from/to` as ISO 8601 writes it.
///
/// # Errors
/// When there is no memory.
pub fn to_csv<T: Listed>(items: &[T], chosen: &[&str]) -> Result<String, csv::Error> {
    let tags = T::LIST.has_labels.then_some("tags");
    let own = ["id", "name"].into_iter().chain(T::COLUMNS.iter().map(|column| column.heading));
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(own.chain(chosen.iter().copied()).chain(tags))?;
    for item in items {
        let columns = T::COLUMNS.iter().map(|column| (column.cell)(item));
        let cells = columns.chain(chosen.iter().map(|column| item.chosen(column)));
        let mut row = vec![item.id().to_string(), item.name().to_owned()];
        row.extend(cells.map(plain));
        row.extend(tags.map(|_| item.tags().join(" ")));
        writer.write_record(row)?;
    }
    let bytes = writer.into_inner().map_err(|error| error.into_error())?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// A cell for a program that reads it.
fn plain(cell: ListCell) -> String {
    match cell {
        ListCell::Missing => String::new(),
        ListCell::Text(words) | ListCell::Moment(words) => words,
        ListCell::State(_, word) => word.to_owned(),
        ListCell::Count(number) | ListCell::Bytes(number) => number.to_string(),
        ListCell::Degrees(number) | ListCell::Number(number) | ListCell::Percent(number) => {
            number.to_string()
        }
        ListCell::Headline(found) => headline(&found),
        ListCell::Part(done, all) => format!("{done} of {all}"),
        ListCell::Span(from, to) => format!("{from}/{}", to.unwrap_or_default()),
    }
}

/// The sentence that a list has if it is sorted by errors on different data.
pub const NOT_COMPARABLE: &str = "Errors on different data are not comparable.";

/// Whether `sort`, an order of a list, is by an error.
pub fn is_by_error(sort: &str) -> bool {
    sort.trim_start_matches('-') == Sort::Rmse.as_str()
}

/// Whether an item has an error in its column.
pub fn has_error<T: Listed>(item: &T) -> bool {
    T::COLUMNS
        .iter()
        .any(|column| column.heading.ends_with("RMSE") && (column.cell)(item) != ListCell::Missing)
}

/// The different data, by name, that the errors of these items are on.
pub fn data_of_errors<T: Listed>(items: &[T]) -> BTreeSet<String> {
    let names = |item: &T| {
        let column = T::COLUMNS.iter().find(|column| column.heading == "data")?;
        match (column.cell)(item) {
            ListCell::Text(names) => Some(names),
            _ => None,
        }
    };
    items.iter().filter(|item| has_error(*item)).filter_map(names).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;
    use wire::Checkpoint;

    use super::*;

    #[test]
    fn only_items_with_errors_count_their_data() {
        let checkpoint = |data: &str, rmse_deg: Option<f64>| -> Checkpoint {
            let metrics =
                rmse_deg.map_or(json!({}), |rmse_deg| json!({"validation/rmse_deg": rmse_deg}));
            serde_json::from_value(json!({
                "id": 1, "job": 2, "run": 3, "architecture": "cdt", "digest": "0".repeat(64), "step": 10,
                "final": true, "best": true, "last": true, "metrics": metrics, "files": [],
                "data": data, "created_at": "2026-11-28T12:00:00Z",
            }))
            .unwrap()
        };
        let mut items = vec![
            checkpoint("lab", Some(0.5)),
            checkpoint("lab", Some(0.7)),
            checkpoint("stream", None),
        ];
        assert_eq!(data_of_errors(&items).into_iter().collect::<Vec<_>>(), ["lab"]);
        items.push(checkpoint("stream", Some(0.1)));
        assert_eq!(data_of_errors(&items).len(), 2);
        assert!(is_by_error("-rmse") && !is_by_error("name"));
    }
}

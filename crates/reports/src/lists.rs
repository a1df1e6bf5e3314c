//! Lists of resources as CSV, for spreadsheets and notebooks.

use wire::{ListCell, Listed};

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

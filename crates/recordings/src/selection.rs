//! Finds the columns that a spec names among those of a file.

use std::ops::Range;

use spec::{ImportColumns, ImportSpec, list_elements};

/// The largest number of elements in a list of which the spec names some. It bounds the memory of a
/// batch of rows.
pub(crate) const MAX_ELEMENTS: usize = 1000;

/// A requested column.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Selected {
    /// Its index among the columns of the file.
    pub place: usize,
    /// The elements of its lists that the spec names; `None` if it names the column alone.
    pub elements: Option<Range<usize>>,
}

/// Finds each column of `columns` among those of the file. Each must occur once. Spaces around a
/// name count only if two columns differ in nothing else.
///
/// Returns their indices, in the order of [`ImportColumns::named`].
///
/// # Errors
/// The missing columns, with the existing ones.
pub(crate) fn find_columns(
    columns: &ImportColumns,
    existing: &[&str],
) -> Result<Vec<usize>, String> {
    let found = find(columns, existing, &|name| find_column(name, existing))?;
    Ok(found.into_iter().map(|column| column.place).collect())
}

/// Finds each column of `spec` like [`find_columns`], in a file whose columns may have lists. A name
/// such as `state[2]` is an element of the column `state`, unless a column has the whole name.
///
/// # Errors
/// The missing columns, with the existing ones; or elements that are not one for each joint.
pub(crate) fn find_elements(spec: &ImportSpec, existing: &[&str]) -> Result<Vec<Selected>, String> {
    let find_element = |name: &str| {
        if let Some(whole) = find_column(name, existing)? {
            return Ok(Some(whole));
        }
        let Some((list, elements)) = list_elements(name) else { return Ok(None) };
        let column = find_column(list, existing)?;
        Ok(column.map(|column| Selected { elements: Some(elements), ..column }))
    };
    let found = find(&spec.columns, existing, &find_element)?;
    for ((field, name), column) in spec.columns.named().into_iter().zip(&found) {
        if let Some(elements) = &column.elements {
            check_elements(&field, name, elements.len(), spec)?;
        }
    }
    Ok(found)
}

fn check_elements(field: &str, name: &str, count: usize, spec: &ImportSpec) -> Result<(), String> {
    let quantity = field.split('[').next().unwrap_or(field);
    if field == "recording" {
        return Err(format!("columns.recording is {name:?}, allowed: a column without lists"));
    }
    if spec.has_one_column(quantity) {
        let joints = spec.joints();
        let plural = if count == 1 { "" } else { "s" };
        return if count == joints {
            Ok(())
        } else {
            Err(format!(
                "columns.{quantity} is {name:?}, which is {count} element{plural}, allowed: {joints}, one \
                 for each joint"
            ))
        };
    }
    match count {
        1 => Ok(()),
        _ => Err(format!(
            "columns.{field} is {name:?}, which is {count} elements, allowed: 1, such as \"state[0]\"; a \
             range stands alone for all joints"
        )),
    }
}

type Finder<'a> = &'a dyn Fn(&str) -> Result<Option<Selected>, ()>;

fn find(
    columns: &ImportColumns,
    existing: &[&str],
    finder: Finder<'_>,
) -> Result<Vec<Selected>, String> {
    let mut found: Vec<(String, Selected)> = Vec::new();
    let mut missing = Vec::new();
    for (field, name) in columns.named() {
        let Some(column) = finder(name)
            .map_err(|()| format!("it has more than one column {name:?} (columns.{field})"))?
        else {
            missing.push(format!("{name:?} (columns.{field})"));
            continue;
        };
        if let Some((other, _)) = found.iter().find(|(_, other)| column.overlaps(other)) {
            return Err(format!(
                "columns.{field} and columns.{other} are both its column {:?}",
                existing[column.place]
            ));
        }
        found.push((field, column));
    }
    if missing.is_empty() {
        return Ok(found.into_iter().map(|(_, column)| column).collect());
    }
    Err(format!("it has no column {}; it has {}", missing.join(", "), listed(existing)))
}

impl Selected {
    /// Whether both have a value in common.
    fn overlaps(&self, other: &Self) -> bool {
        let have_elements_apart = match (&self.elements, &other.elements) {
            (Some(one), Some(other)) => one.end <= other.start || other.end <= one.start,
            _ => false,
        };
        self.place == other.place && !have_elements_apart
    }
}

/// A column by its name, if there is one; an error if there are several.
fn find_column(name: &str, existing: &[&str]) -> Result<Option<Selected>, ()> {
    let equal: &dyn Fn(&str) -> bool = &|other| other == name;
    let trimmed: &dyn Fn(&str) -> bool = &|other| other.trim() == name.trim();
    for is_it in [equal, trimmed] {
        let mut places = existing.iter().enumerate().filter(|(_, other)| is_it(other));
        match (places.next(), places.next()) {
            (Some((place, _)), None) => return Ok(Some(Selected { place, elements: None })),
            (Some(_), Some(_)) => return Err(()),
            (None, _) => {}
        }
    }
    Ok(None)
}

/// A list of names for an error, cut if there are too many.
pub(crate) fn listed<T: AsRef<str>>(names: &[T]) -> String {
    const SHOWN: usize = 50;
    let shown: Vec<String> =
        names.iter().take(SHOWN).map(|name| format!("{:?}", name.as_ref())).collect();
    match names.len().checked_sub(SHOWN) {
        None | Some(0) => shown.join(", "),
        Some(more) => format!("{} and {more} more", shown.join(", ")),
    }
}

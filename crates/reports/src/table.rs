//! A result as a table: columns, and rows of cells. The page, the terminal, CSV and Markdown show it.

use wire::Measure;

use crate::Cell;

/// The edge of its column at which a cell is aligned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Align {
    /// For words.
    Left,
    /// For numbers.
    Right,
}

/// A result: columns, and rows of cells.
#[derive(Debug)]
pub struct Table {
    /// A heading for above the table; empty where the surroundings say what it shows.
    pub title: String,
    /// A note on the numbers, for below the table. It may be empty.
    pub note: String,
    /// The columns, from left to right.
    pub columns: Vec<Column>,
    /// The rows, from top to bottom, each with a cell for every column.
    pub rows: Vec<Vec<Cell>>,
    /// The address of the page that a row leads to; empty, or missing at the end, for rows without one.
    pub links: Vec<String>,
}

/// The head of a column.
#[derive(Clone, Debug)]
pub struct Column {
    /// The name of its quantity, followed by the unit if its cells do not say it: `RMSE, °`.
    pub heading: String,
    /// Where its heading and cells are aligned.
    pub align: Align,
    /// What its cells mean; empty if the heading says it.
    pub about: String,
}

/// A table that grows column by column over rows of an `R`.
#[derive(Debug)]
pub struct TableOf<R> {
    rows: Vec<R>,
    table: Table,
}

impl<R> TableOf<R> {
    /// A table without columns.
    pub fn new(rows: impl IntoIterator<Item = R>) -> Self {
        let rows: Vec<R> = rows.into_iter().collect();
        let table = Table {
            title: String::new(),
            note: String::new(),
            columns: Vec::new(),
            rows: rows.iter().map(|_| Vec::new()).collect(),
            links: Vec::new(),
        };
        Self { rows, table }
    }

    /// Gives each row the page that it leads to.
    #[must_use]
    pub fn linked(mut self, link: impl Fn(&R) -> Option<String>) -> Self {
        self.table.links = self.rows.iter().map(|row| link(row).unwrap_or_default()).collect();
        self
    }

    /// Adds a column of words.
    #[must_use]
    pub fn text<C: Into<Cell>>(self, heading: &str, cell: impl Fn(&R) -> C) -> Self {
        self.column(heading, Align::Left, "", cell)
    }

    /// Adds a column of numbers.
    #[must_use]
    pub fn number<C: Into<Cell>>(self, heading: &str, cell: impl Fn(&R) -> C) -> Self {
        self.column(heading, Align::Right, "", cell)
    }

    /// Adds a column for each measure, with values from the part of a row that holds them.
    #[must_use]
    pub fn measures<'a, T: 'a>(
        self,
        measures: impl IntoIterator<Item = Measure<T>>,
        part: impl Fn(&R) -> Option<&'a T>,
    ) -> Self {
        measures.into_iter().fold(self, |table, Measure { title, unit, about, get, .. }| {
            let heading = match unit.symbol() {
                "" => title.to_owned(),
                symbol => format!("{title}, {symbol}"),
            };
            let cell = |row: &R| part(row).map(|part| Cell::measured(get(part), unit));
            table.column(&heading, Align::Right, about, cell)
        })
    }

    /// Adds a column. `about` says what its cells mean.
    #[must_use]
    pub fn column<C: Into<Cell>>(
        mut self,
        heading: &str,
        align: Align,
        about: &str,
        cell: impl Fn(&R) -> C,
    ) -> Self {
        let column = Column { heading: heading.to_owned(), align, about: about.to_owned() };
        self.table.columns.push(column);
        for (row, cells) in self.rows.iter().zip(&mut self.table.rows) {
            cells.push(cell(row).into());
        }
        self
    }

    /// The table, with a title and a note.
    pub fn titled(self, title: impl Into<String>, note: impl Into<String>) -> Table {
        self.table.titled(title, note)
    }

    /// The table in Markdown.
    pub fn to_markdown(&self) -> String {
        self.table.to_markdown()
    }
}

impl Table {
    /// A table without title, note and rows.
    pub fn new<S: Into<String>>(columns: impl IntoIterator<Item = (S, Align)>) -> Self {
        let column = |(heading, align): (S, Align)| Column {
            heading: heading.into(),
            align,
            about: String::new(),
        };
        let columns = columns.into_iter().map(column).collect();
        let (title, note) = (String::new(), String::new());
        Self { title, note, columns, rows: Vec::new(), links: Vec::new() }
    }

    /// The table without the intervals of its means.
    #[must_use]
    pub(crate) fn means(self) -> Self {
        let mean = |row: Vec<Cell>| row.into_iter().map(Cell::mean).collect();
        Self { rows: self.rows.into_iter().map(mean).collect(), ..self }
    }

    /// The table without columns in which no row has a value.
    #[must_use]
    pub(crate) fn without_empty_columns(self) -> Self {
        let has_value = |k: &usize| self.rows.iter().any(|row| row[*k] != Cell::Missing);
        let kept: Vec<usize> = (0..self.columns.len()).filter(has_value).collect();
        let columns = kept.iter().map(|&k| self.columns[k].clone()).collect();
        let row = |row: &Vec<Cell>| kept.iter().map(|&k| row[k].clone()).collect();
        Self { columns, rows: self.rows.iter().map(row).collect(), ..self }
    }

    /// Gives it a title and a note.
    #[must_use]
    pub(crate) fn titled(self, title: impl Into<String>, note: impl Into<String>) -> Self {
        Self { title: title.into(), note: note.into(), ..self }
    }

    /// The table with a row for each column but the first, whose heading becomes `first`, and a
    /// column for each row. Links of rows are left out.
    #[must_use]
    pub fn transposed(&self, first: &str) -> Self {
        let own = Column { heading: first.to_owned(), align: Align::Left, about: String::new() };
        let of_row = |row: &Vec<Cell>| Column {
            heading: row.first().map(Cell::value).unwrap_or_default(),
            align: self.columns.get(1).map_or(Align::Left, |column| column.align),
            about: String::new(),
        };
        let columns = std::iter::once(own).chain(self.rows.iter().map(of_row)).collect();
        let row = |(k, column): (usize, &Column)| {
            let heading = std::iter::once(Cell::from(column.heading.as_str()));
            heading.chain(self.rows.iter().map(|row| row[k].clone())).collect()
        };
        Self {
            title: self.title.clone(),
            note: self.note.clone(),
            columns,
            rows: self.columns.iter().enumerate().skip(1).map(row).collect(),
            links: Vec::new(),
        }
    }

    /// Each row with the address of the page that it leads to, which may be empty.
    pub fn linked_rows(&self) -> impl Iterator<Item = (&str, &[Cell])> {
        let links = self.links.iter().map(String::as_str).chain(std::iter::repeat(""));
        links.zip(self.rows.iter().map(Vec::as_slice))
    }

    /// Adds a row. Missing cells stay empty.
    pub fn push<C: Into<Cell>>(&mut self, row: Vec<C>) {
        self.rows.push(row.into_iter().map(Into::into).collect());
    }

    /// The table as CSV.
    ///
    /// # Errors
    /// When a row has more or fewer cells than there are columns.
    pub fn to_csv(&self) -> Result<String, csv::Error> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record(self.columns.iter().map(|column| &column.heading))?;
        for row in &self.rows {
            writer.write_record(row.iter().map(Cell::value))?;
        }
        let bytes = writer.into_inner().map_err(|error| error.into_error())?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }

    /// The table in Markdown.
    pub(crate) fn to_markdown(&self) -> String {
        let headings = self.columns.iter().map(|column| column.heading.clone());
        let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
        let rows = self.rows.iter().map(|row| line(row.iter().map(Cell::to_string).collect()));
        let rule = format!("|{}\n", "---|".repeat(self.columns.len()));
        line(headings.collect()) + &rule + &rows.collect::<String>()
    }

    /// The table in plain text: a header line and rows, with two spaces between columns.
    pub fn render(&self) -> String {
        let header = self.columns.iter().map(|column| column.heading.clone()).collect();
        let rows = self.rows.iter().map(|row| row.iter().map(Cell::to_string).collect());
        let lines: Vec<Vec<String>> = std::iter::once(header).chain(rows).collect();
        let widths: Vec<usize> = (0..self.columns.len())
            .map(|k| lines.iter().filter_map(|row| row.get(k)).map(|cell| width(cell)).max())
            .map(Option::unwrap_or_default)
            .collect();
        let mut text = String::new();
        for row in &lines {
            let mut line = String::new();
            for (k, cell) in row.iter().take(self.columns.len()).enumerate() {
                let gap = " ".repeat(widths[k] - width(cell));
                match self.columns[k].align {
                    Align::Left => line.extend([cell, gap.as_str(), "  "]),
                    Align::Right => line.extend([gap.as_str(), cell, "  "]),
                }
            }
            text.push_str(line.trim_end());
            text.push('\n');
        }
        text
    }

    /// The table in plain text, below its title and its note. Empty without rows.
    pub fn with_title(&self) -> String {
        let Self { title, note, .. } = self;
        match (self.rows.is_empty(), note.is_empty()) {
            (true, _) => String::new(),
            (false, true) => format!("{title}\n\n{}\n", self.render()),
            (false, false) => format!("{title}\n{note}\n\n{}\n", self.render()),
        }
    }
}

/// Width on the terminal. Every character that we print is one column wide.
fn width(cell: &str) -> usize {
    cell.chars().count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_as_wide_as_their_widest_cell_and_lines_end_without_spaces() {
        let mut table = Table::new([("id", Align::Right), ("name", Align::Left)]);
        table.push(vec!["7", "a"]);
        table.push(vec!["1234", "längst"]);
        assert_eq!(table.render(), "  id  name\n   7  a\n1234  längst\n");
    }

    #[test]
    fn a_transposed_table_has_a_row_for_each_column() {
        let columns =
            [("parameter", Align::Left), ("4 train", Align::Right), ("7 train", Align::Right)];
        let mut table = Table::new(columns);
        table.push(vec!["seed", "0", "1"]);
        table.push(vec!["steps", "10", "20"]);
        let across = table.transposed("run");
        assert_eq!(
            across.render(),
            "run      seed  steps\n4 train     0     10\n7 train     1     20\n"
        );
    }
}

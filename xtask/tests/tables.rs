//! Checks tables of the documents: a merge of two versions left rows of both.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use pulldown_cmark::{Event, Options, Parser, Tag, TagEnd};

#[test]
fn no_row_of_a_document_is_there_twice() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let documents = documents(root);
    assert!(documents.len() > 20, "{documents:?}");
    let faults: Vec<String> = documents
        .iter()
        .flat_map(|document| {
            let tables = tables(&fs::read_to_string(document).unwrap());
            tables.iter().flat_map(|rows| doubled(rows)).collect::<Vec<_>>()
        })
        .collect();
    assert!(faults.is_empty(), "{faults:#?}");
}

/// Each command of the page has one row, whatever words describe it.
#[test]
fn the_commands_of_a_row_are_in_no_other() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let text = fs::read_to_string(root.join("docs/commands.md")).unwrap();
    let tables = tables(&text);
    assert!(tables[0].len() > 20, "{tables:?}");
    let commands: Vec<Vec<String>> = tables[0].iter().map(|cells| vec![cells[1].clone()]).collect();
    assert_eq!(doubled(&commands), Vec::<String>::new());
}

#[test]
fn doubled_rows_and_a_second_line_under_the_heading_are_found() {
    let table = "| a | b |\n|---|---|\n|---|---|\n| 1 | `x` |\n| 2 | `x` |\n| 1 | `x` |\n";
    let found = tables(table);
    assert_eq!(found[0][1], ["1", "x"]);
    assert_eq!(doubled(&found[0]), ["--- | ---", "1 | x"]);
}

/// Rows that come a second time, and rows of nothing but dashes.
fn doubled(rows: &[Vec<String>]) -> Vec<String> {
    let mut seen = HashSet::new();
    let is_line = |row: &[String]| {
        row.iter().all(|cell| cell.len() >= 3 && cell.chars().all(|c| c == '-' || c == ':'))
    };
    let faulty = rows.iter().filter(|row| is_line(row) || !seen.insert(*row));
    faulty.map(|row| row.join(" | ")).collect()
}

/// The rows of each table, without the heading, as text.
fn tables(text: &str) -> Vec<Vec<Vec<String>>> {
    let mut tables: Vec<Vec<Vec<String>>> = Vec::new();
    let mut cell: Option<String> = None;
    for event in Parser::new_ext(text, Options::ENABLE_TABLES) {
        match event {
            Event::Start(Tag::Table(_)) => tables.push(Vec::new()),
            Event::Start(Tag::TableRow) => tables.last_mut().unwrap().push(Vec::new()),
            Event::Start(Tag::TableCell) => cell = Some(String::new()),
            Event::Text(part) | Event::Code(part) => {
                if let Some(cell) = &mut cell {
                    cell.push_str(&part);
                }
            }
            Event::End(TagEnd::TableCell) => {
                let cell = cell.take().unwrap_or_default();
                if let Some(row) = tables.last_mut().and_then(|rows| rows.last_mut()) {
                    row.push(cell);
                }
            }
            _ => {}
        }
    }
    tables
}

/// Markdown files of the repository.
fn documents(root: &Path) -> Vec<PathBuf> {
    let listed = Command::new("git").args(["ls-files", "*.md"]).current_dir(root).output().unwrap();
    assert!(listed.status.success(), "{}", String::from_utf8_lossy(&listed.stderr));
    let names = String::from_utf8(listed.stdout).unwrap();
    names.lines().map(|name| root.join(name)).filter(|path| path.exists()).collect()
}

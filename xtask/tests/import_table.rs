//! Compares the table of crates in ARCHITECTURE.md with the manifests.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

use serde_json::Value;

/// One row of the table.
#[derive(Debug)]
struct Room {
    floor: u32,
    may_import: BTreeSet<String>,
}

#[test]
fn crates_import_only_what_the_architecture_allows() {
    let rooms = rooms();
    for (name, imports) in imports() {
        let room = rooms.get(&name).unwrap_or_else(|| panic!("{name} is not in the table"));
        let forbidden: Vec<&String> = imports.difference(&room.may_import).collect();
        assert!(forbidden.is_empty(), "{name} must not import {forbidden:?}");
    }
}

#[test]
fn every_room_of_the_table_exists() {
    let crates: BTreeSet<String> = imports().into_keys().collect();
    let rooms: BTreeSet<String> = rooms().into_keys().collect();
    assert_eq!(rooms, crates);
}

#[test]
fn imports_only_go_down() {
    let rooms = rooms();
    for (name, imports) in imports() {
        for import in imports {
            assert!(rooms[&import].floor < rooms[&name].floor, "{name} imports {import}");
        }
    }
}

/// The rows `| floor | `crate` | owns | may import |`.
fn rooms() -> BTreeMap<String, Room> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../ARCHITECTURE.md");
    let text = std::fs::read_to_string(path).unwrap();
    let mut rooms = BTreeMap::new();
    let mut imports = BTreeMap::new();
    for line in text.lines() {
        let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
        let [floor, name, _, may_import] = cells[..] else { continue };
        let (Ok(floor), Some(name)) = (floor.parse(), name.split('`').nth(1)) else { continue };
        rooms.insert(name.to_owned(), floor);
        imports.insert(name.to_owned(), may_import.to_owned());
    }
    assert!(!rooms.is_empty(), "ARCHITECTURE.md has no table of crates");
    let all: BTreeSet<String> = rooms.keys().cloned().collect();
    rooms
        .into_iter()
        .map(|(name, floor)| {
            let may_import = match imports[&name].as_str() {
                "all" => all.clone(),
                "nothing of ours" => BTreeSet::new(),
                listed => listed.split(", ").map(str::to_owned).collect(),
            };
            (name, Room { floor, may_import })
        })
        .collect()
}

/// Every crate except this one, with the crates of this repository that its code uses. Tests may
/// use more.
fn imports() -> BTreeMap<String, BTreeSet<String>> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--no-deps", "--offline", "--format-version", "1"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap();
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    let packages = metadata["packages"].as_array().unwrap();
    let names: BTreeSet<&str> =
        packages.iter().map(|package| package["name"].as_str().unwrap()).collect();
    packages
        .iter()
        .filter(|package| package["name"] != "xtask")
        .map(|package| {
            let imports = package["dependencies"]
                .as_array()
                .unwrap()
                .iter()
                .filter(|dependency| dependency["kind"] != "dev")
                .map(|dependency| dependency["name"].as_str().unwrap())
                .filter(|name| names.contains(name))
                .map(str::to_owned)
                .collect();
            (package["name"].as_str().unwrap().to_owned(), imports)
        })
        .collect()
}

//! Looks for circles of imports among the files of each crate.
//!
//! A file imports the files that define the items it names. A path is followed through exports of other
//! modules to the definition, so a file that only exports an item again imports nothing. Tests within
//! a file do not count, and neither do methods that are called on a value, and `$crate` in a macro, which
//! is imported where the macro is used.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod circles;
mod modules;
mod scan;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use circles::{describe, long_circles};
use modules::Crate;

#[test]
fn circles_of_imports_have_three_files_at_most() {
    let mut circles = Vec::new();
    for root in roots() {
        let imports = Crate::read(&root).imports();
        circles.extend(long_circles(&imports).iter().map(|circle| describe(circle, &imports)));
    }
    assert!(circles.is_empty(), "circles of imports:\n\n{}", circles.join("\n\n"));
}

#[test]
fn a_circle_through_exports_aliases_and_macros_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let files = [
        ("lib.rs", "mod a; mod b; mod d; pub use b::c::C;"),
        ("a.rs", "use crate::b; fn f() -> b::B { wrap!({ crate::C }) }"),
        ("b/mod.rs", "pub mod c; pub struct B; pub use c::Other; #[cfg(test)] mod tests {}"),
        ("b/c.rs", "use super::super::d::{self as last}; pub struct C(last::D); pub struct Other;"),
        (
            "d.rs",
            "pub struct D(e::E); mod e { pub struct E(crate::a::A); }\n#[cfg(test)] use crate::X;",
        ),
    ];
    for (name, text) in files {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }
    let imports = Crate::read(&folder.path().join("lib.rs")).imports();
    let named = |path: &Path| path.strip_prefix(folder.path()).unwrap().display().to_string();
    let found: Vec<(String, Vec<String>)> = imports
        .iter()
        .map(|(file, imported)| (named(file), imported.keys().map(|file| named(file)).collect()))
        .collect();
    let expected: Vec<(String, Vec<String>)> =
        [("a.rs", &["b/c.rs", "b/mod.rs"][..]), ("b/c.rs", &["d.rs"]), ("d.rs", &["a.rs"])]
            .map(|(file, imported)| {
                (file.to_owned(), imported.iter().copied().map(String::from).collect())
            })
            .into();
    assert_eq!(found, expected);
    assert!(long_circles(&imports).is_empty(), "three files are allowed");
}

/// The files at the roots of this repository's libraries and programs.
fn roots() -> Vec<PathBuf> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--no-deps", "--offline", "--format-version", "1"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap();
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    let packages = metadata["packages"].as_array().unwrap().iter();
    let targets = packages.flat_map(|package| package["targets"].as_array().unwrap());
    let is_product = |target: &&Value| {
        target["kind"] == "lib" || target["kind"][0] == "lib" || target["kind"][0] == "bin"
    };
    targets
        .filter(is_product)
        .map(|target| PathBuf::from(target["src_path"].as_str().unwrap()))
        .collect()
}

//! The licences of the crates in the program, which must accompany it.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::fs;
use std::path::Path;

use anyhow::{Context, ensure};
use serde::Deserialize;

use crate::process::command;

/// Beginnings of the names of files with licences and notices.
const FILES: [&str; 4] = ["LICENSE", "LICENCE", "COPYING", "NOTICE"];

#[derive(Deserialize)]
struct Metadata {
    packages: Vec<Package>,
}

#[derive(Deserialize)]
struct Package {
    name: String,
    version: String,
    license: Option<String>,
    repository: Option<String>,
    manifest_path: String,
    /// Null for crates of this repository.
    source: Option<String>,
}

/// A list of all crates with their licences, then each text of a licence once, with the crates that have it.
pub fn text() -> anyhow::Result<String> {
    let built = built()?;
    let metadata = cargo(&["metadata", "--format-version", "1", "--locked"])?;
    let metadata: Metadata = serde_json::from_str(&metadata).context("cargo metadata")?;
    let mut packages: Vec<Package> = metadata
        .packages
        .into_iter()
        .filter(|package| package.source.is_some() && built.contains(&package.label()))
        .collect();
    packages.sort_by_key(Package::label);
    ensure!(packages.len() > 100, "cargo tree names {} crates", packages.len());

    let mut list = String::from(
        "torqued is linked with these crates and Rust's standard library (MIT OR Apache-2.0).\n\n",
    );
    let mut texts: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for package in &packages {
        let licence = package.license.as_deref().unwrap_or("see below");
        let repository = package.repository.as_deref().unwrap_or_default();
        let _ = writeln!(list, "{}: {licence} {repository}", package.label());
        for text in package.texts()? {
            texts.entry(text).or_default().push(package.label());
        }
    }
    let mut texts: Vec<(String, Vec<String>)> = texts.into_iter().collect();
    texts.sort_by(|(_, a), (_, b)| a.cmp(b));
    for (text, packages) in texts {
        let _ = write!(list, "\n{}\n{}:\n\n{text}\n", "-".repeat(80), packages.join(", "));
    }
    Ok(list)
}

/// Names and versions of the crates that are linked into the program on this platform.
fn built() -> anyhow::Result<BTreeSet<String>> {
    let arguments = ["tree", "--package", "torqued", "--locked", "--edges", "normal"];
    let tree = cargo(&[&arguments[..], &["--prefix", "none", "--format", "{p}"]].concat())?;
    Ok(tree.lines().filter_map(label).collect())
}

/// `NAME VERSION` from `NAME vVERSION (PLACE)`.
fn label(line: &str) -> Option<String> {
    let mut words = line.split_whitespace();
    let (name, version) = (words.next()?, words.next()?);
    Some(format!("{name} {}", version.strip_prefix('v')?))
}

fn cargo(arguments: &[&str]) -> anyhow::Result<String> {
    let output = command("cargo", arguments).output().context("cannot run cargo")?;
    let error = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "cargo {}: {error}", arguments.join(" "));
    Ok(String::from_utf8(output.stdout)?)
}

impl Package {
    fn label(&self) -> String {
        format!("{} {}", self.name, self.version)
    }

    /// The licences and notices beside the manifest.
    fn texts(&self) -> anyhow::Result<Vec<String>> {
        let folder = Path::new(&self.manifest_path).parent().unwrap_or_else(|| Path::new("/"));
        let mut files = Vec::new();
        for entry in
            fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))?
        {
            let path = entry?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy().to_uppercase();
            if path.is_file() && FILES.iter().any(|begin| name.starts_with(begin)) {
                files.push(path);
            }
        }
        files.sort();
        let read =
            |path| fs::read(path).map(|bytes| String::from_utf8_lossy(&bytes).trim().to_owned());
        Ok(files.iter().map(read).collect::<Result<_, _>>()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_of_the_tree_names_a_crate_and_its_version() {
        assert_eq!(label("serde v1.0.2").as_deref(), Some("serde 1.0.2"));
        assert_eq!(label("spec v0.1.0 (/a b/spec) (*)").as_deref(), Some("spec 0.1.0"));
        assert_eq!(label(""), None);
    }

    #[test]
    fn every_crate_is_named_and_the_texts_of_their_licences_are_there_once() {
        let text = text().unwrap();
        assert!(text.contains("\nserde 1.") && text.contains("\ntokio 1."), "{text:.2000}");
        assert!(!text.contains("\nproptest "), "what only tests use is not in the program");
        let apache = text.matches("TERMS AND CONDITIONS FOR USE, REPRODUCTION").count();
        let crates = text.lines().filter(|line| line.contains("Apache-2.0")).count();
        assert!(apache > 0 && apache < crates / 2, "{apache} texts for {crates} crates");
    }
}

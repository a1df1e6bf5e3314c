//! Checks links between the documents: their files and headings exist.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use pulldown_cmark::{Event, Options, Parser, Tag, TagEnd};

#[test]
fn every_link_of_a_document_leads_somewhere() {
    let documents = documents();
    assert!(documents.len() > 20, "{documents:?}");
    let broken: Vec<String> =
        documents.iter().flat_map(|document| broken_links(document)).collect();
    assert!(broken.is_empty(), "{broken:#?}");
}

/// Markdown files of the repository.
fn documents() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let listed = Command::new("git")
        .args(["ls-files", "--cached", "--others", "--exclude-standard", "*.md"])
        .current_dir(root)
        .output()
        .unwrap();
    assert!(listed.status.success(), "{}", String::from_utf8_lossy(&listed.stderr));
    let names = String::from_utf8(listed.stdout).unwrap();
    names.lines().map(|name| root.join(name)).filter(|path| path.exists()).collect()
}

fn broken_links(document: &Path) -> Vec<String> {
    let is_outside = |link: &String| link.contains("://") || link.starts_with("mailto:");
    links(&fs::read_to_string(document).unwrap())
        .into_iter()
        .filter(|link| !is_outside(link))
        .filter(|link| !leads_somewhere(document, link))
        .map(|link| format!("{}: {link}", document.display()))
        .collect()
}

fn leads_somewhere(document: &Path, link: &str) -> bool {
    let (file, heading) = link.split_once('#').map_or((link, None), |(a, b)| (a, Some(b)));
    let target = match file {
        "" => document.to_owned(),
        file => document.parent().unwrap().join(file),
    };
    match heading {
        None => target.exists(),
        Some(heading) => {
            fs::read_to_string(&target).is_ok_and(|text| anchors(&text).contains(heading))
        }
    }
}

fn links(text: &str) -> Vec<String> {
    parser(text)
        .filter_map(|event| match event {
            Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) => {
                Some(dest_url.into_string())
            }
            _ => None,
        })
        .collect()
}

/// The anchors of a document's headings, as hosting sites for repositories generate them.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut anchors = BTreeSet::new();
    let mut heading: Option<String> = None;
    for event in parser(text) {
        match event {
            Event::Start(Tag::Heading { .. }) => heading = Some(String::new()),
            Event::Text(part) | Event::Code(part) => {
                if let Some(heading) = &mut heading {
                    heading.push_str(&part);
                }
            }
            Event::End(TagEnd::Heading(_)) => {
                anchors.extend(heading.take().map(|heading| anchor(&heading)));
            }
            _ => {}
        }
    }
    anchors
}

fn anchor(heading: &str) -> String {
    heading
        .to_lowercase()
        .chars()
        .filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'))
        .map(|c| if c == ' ' { '-' } else { c })
        .collect()
}

fn parser(text: &str) -> Parser<'_> {
    Parser::new_ext(text, Options::ENABLE_TABLES)
}

#[test]
fn headings_have_the_anchors_that_links_name() {
    assert_eq!(anchor("Check the server's health"), "check-the-servers-health");
    let found = anchors("# The `config.json` of one\n\ntext\n\n## α, β");
    assert_eq!(found, BTreeSet::from(["the-configjson-of-one".into(), "α-β".into()]));
}

#[test]
fn links_are_found_in_tables_and_not_in_code() {
    let text = "| a | b |\n|---|---|\n| [x](y.md#z) | ![i](i.png) |\n\n`[no](no.md)`\n";
    assert_eq!(links(text), ["y.md#z", "i.png"]);
}

//! Labels: names, notes and tags that people give to items.

use std::collections::BTreeSet;

use store::Labels;
use wire::{ItemKind, LabelChange, TextChange};

use crate::app::App;
use crate::app::questions::RequestViolations;
use crate::error::ApiError;
use crate::limits::{NAME_CHARACTERS, NOTE_BYTES, TAG_CHARACTERS, TAGS};

/// The allowed tags, in words.
pub const TAG: &str = "1 to 64 letters, digits and . _ - : / @ + = without accents, beginning with a letter or a digit";

/// The allowed tags, as a regular expression.
pub const TAG_PATTERN: &str = "^[A-Za-z0-9][A-Za-z0-9._:/@+=-]{0,63}$";

/// The allowed aliases, in words. None is a number, so paths tell them from ids.
pub const ALIAS: &str =
    "1 to 64 letters, digits and . _ - without accents, beginning with a letter";

impl App {
    /// # Errors
    /// When the labels are not allowed, there would be too many tags, or the item does not exist.
    pub(crate) async fn label(
        &self,
        kind: ItemKind,
        id: i64,
        change: &LabelChange,
    ) -> Result<(), ApiError> {
        check(kind, change)?;
        Ok(self.store.change_labels(kind, id, change).await?)
    }
}

pub fn is_tag(tag: &str) -> bool {
    let is_plain = |b: u8| b.is_ascii_alphanumeric() || b"._-:/@+=".contains(&b);
    (1..=TAG_CHARACTERS).contains(&tag.len())
        && tag.as_bytes()[0].is_ascii_alphanumeric()
        && tag.bytes().all(is_plain)
}

/// Whether a text may be the alias of a checkpoint: [`ALIAS`].
pub fn is_alias(alias: &str) -> bool {
    let is_plain = |b: u8| b.is_ascii_alphanumeric() || b"._-".contains(&b);
    (1..=TAG_CHARACTERS).contains(&alias.len())
        && alias.as_bytes()[0].is_ascii_alphabetic()
        && alias.bytes().all(is_plain)
}

/// Whether a text is one line with at most `characters` characters, and not blank.
pub fn is_line(text: &str, characters: usize) -> bool {
    let ends_a_line = |c: char| c.is_control() || matches!(c, '\u{2028}' | '\u{2029}');
    !text.trim().is_empty() && text.chars().count() <= characters && !text.contains(ends_a_line)
}

fn is_note(note: &str) -> bool {
    let is_strange = |c: char| c.is_control() && !matches!(c, '\n' | '\r' | '\t');
    (1..=NOTE_BYTES).contains(&note.len()) && !note.contains(is_strange)
}

/// The labels in the query of a submission.
///
/// # Errors
/// Every label that is not allowed.
pub fn submitted(
    name: Option<String>,
    note: Option<String>,
    tags: Vec<String>,
) -> Result<Labels, ApiError> {
    let set = |text: &Option<String>| text.clone().map_or(TextChange::Nothing, TextChange::Set);
    let tags: BTreeSet<String> = tags.into_iter().collect();
    let change = LabelChange {
        name: set(&name),
        note: set(&note),
        add_tags: tags.iter().cloned().collect(),
        ..LabelChange::default()
    };
    check(ItemKind::Job, &change).map_err(of_query)?;
    Ok(Labels { name, note, tags })
}

/// The same error with the field that a query has for each tag.
fn of_query(error: ApiError) -> ApiError {
    let ApiError::Labels(mut error) = error else { return error };
    for violation in &mut error.violations {
        if violation.field.starts_with("add_tags") {
            violation.field = "tag".to_owned();
        }
    }
    ApiError::Labels(error)
}

fn check(kind: ItemKind, change: &LabelChange) -> Result<(), ApiError> {
    let LabelChange { name, note, tags, add_tags, remove_tags, add_aliases, remove_aliases } =
        change;
    let mut violations = RequestViolations::default();
    if let TextChange::Set(name) = name
        && !is_line(name, NAME_CHARACTERS)
    {
        violations.add("name", name, format!("1 to {NAME_CHARACTERS} characters in one line"));
    }
    if let TextChange::Set(note) = note
        && !is_note(note)
    {
        let found = format!("{} bytes", note.len());
        violations.add("note", found, format!("text of 1 to {NOTE_BYTES} bytes, or null"));
    }
    let all = tags.as_deref().unwrap_or_default();
    for (field, tags) in [("tags", all), ("add_tags", add_tags), ("remove_tags", remove_tags)] {
        for (index, tag) in tags.iter().enumerate().filter(|(_, tag)| !is_tag(tag)) {
            violations.add(format!("{field}[{index}]"), tag, TAG);
        }
        if tags.len() > TAGS {
            violations.add(field, format!("{} tags", tags.len()), format!("{TAGS} at most"));
        }
    }
    for (field, tags) in [("add_tags", add_tags), ("remove_tags", remove_tags)] {
        if !tags.is_empty() && change.tags.is_some() {
            violations.add(field, tags.join(", "), "left out, because tags replaces all tags");
        }
    }
    for (field, aliases) in [("add_aliases", add_aliases), ("remove_aliases", remove_aliases)] {
        if !aliases.is_empty() && kind != ItemKind::Checkpoint {
            violations.add(
                field,
                aliases.join(", "),
                "left out, because only checkpoints have aliases",
            );
        }
        for (index, alias) in aliases.iter().enumerate().filter(|(_, alias)| !is_alias(alias)) {
            violations.add(format!("{field}[{index}]"), alias, ALIAS);
        }
        if aliases.len() > TAGS {
            violations.add(field, format!("{} aliases", aliases.len()), format!("{TAGS} at most"));
        }
    }
    violations.finish_as(ApiError::Labels)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(change: &LabelChange) -> String {
        check(ItemKind::Run, change).unwrap_err().to_string()
    }

    #[test]
    fn an_alias_is_no_number_and_belongs_to_a_checkpoint() {
        for alias in ["champion", "v1.2_b", "A", &"x".repeat(64)] {
            assert!(is_alias(alias), "{alias}");
        }
        for alias in ["", "7", "7b", "-a", "a/b", "a b", "ä", &"x".repeat(65)] {
            assert!(!is_alias(alias), "{alias}");
        }
        let change =
            LabelChange { add_aliases: vec!["champion".to_owned()], ..LabelChange::default() };
        assert!(refused(&change).contains("only checkpoints have aliases"));
        assert!(check(ItemKind::Checkpoint, &change).is_ok());
        let change = LabelChange { remove_aliases: vec!["7".to_owned()], ..LabelChange::default() };
        assert!(check(ItemKind::Checkpoint, &change).is_err());
    }

    #[test]
    fn a_label_in_a_query_is_refused_as_the_parameter_that_has_it() {
        let name = Some("a\nb".to_owned());
        let error = submitted(name, None, vec!["a b".to_owned()]).unwrap_err();
        let problem = error.to_problem();
        let fields: Vec<&str> = problem.violations.iter().map(|it| it.field.as_str()).collect();
        assert_eq!(fields, ["name", "tag"]);
        assert_eq!(problem.title, "The name, note, tags or aliases are not allowed");
    }

    #[test]
    fn a_tag_has_an_alphabet() {
        for tag in ["a", "7", "sweep/3", "lr=1e-3", "v1.2_b+c", "team:ana@lab", &"x".repeat(64)] {
            assert!(is_tag(tag), "{tag}");
        }
        for tag in ["", "-a", ".", "a b", "ä", "a,b", "a\0", "a%", &"x".repeat(65)] {
            assert!(!is_tag(tag), "{tag}");
        }
    }

    #[test]
    fn all_that_is_wrong_with_labels_is_named_at_once() {
        let set = |text: String| TextChange::Set(text);
        let longest = LabelChange {
            name: set("ä".repeat(200)),
            note: set("# A\n\n- b\t\r\n".to_owned()),
            tags: Some(vec!["a".to_owned(); 32]),
            ..LabelChange::default()
        };
        assert!(check(ItemKind::Run, &longest).is_ok());
        let error = refused(&LabelChange {
            name: set("ä".repeat(201)),
            note: set("x".repeat(10_001)),
            tags: Some(vec!["a b".to_owned()]),
            add_tags: vec!["c".to_owned()],
            ..LabelChange::default()
        });
        for part in ["name", "10001 bytes", "tags[0]", "add_tags", "left out, because tags"] {
            assert!(error.contains(part), "{part}: {error}");
        }
        for name in ["", " ", "a\nb", "a\u{2028}b", "a\0"] {
            let change = LabelChange { name: set(name.to_owned()), ..LabelChange::default() };
            assert!(refused(&change).contains("in one line"), "{name:?}");
        }
        let change = LabelChange { note: set("a\u{7}".to_owned()), ..LabelChange::default() };
        assert!(refused(&change).contains("note"));
    }
}

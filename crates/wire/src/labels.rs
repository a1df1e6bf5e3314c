//! Labels: names, notes and tags that people give to things.

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use utoipa::ToSchema;

/// A change of name, note and tags. It is a merge patch (RFC 7396): a field that is left out stays,
/// and `null` removes it. `add_tags` and `remove_tags` change single tags, so two people can change
/// tags at once.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LabelChange {
    /// One line. Without a name of its own, a job has the name in its spec, and a run or a dataset
    /// has the name of its job.
    #[serde(default, skip_serializing_if = "TextChange::is_nothing")]
    #[schema(value_type = Option<String>, min_length = 1, max_length = 200, example = "baseline, 3 seeds")]
    pub name: TextChange,
    /// Markdown, stored and shown as plain text.
    #[serde(default, skip_serializing_if = "TextChange::is_nothing")]
    #[schema(value_type = Option<String>, min_length = 1, max_length = 10_000)]
    pub note: TextChange,
    /// All tags, which replace the present ones.
    #[serde(default, deserialize_with = "all_tags", skip_serializing_if = "Option::is_none")]
    #[schema(max_items = 32, example = json!(["baseline", "sweep/3"]))]
    pub tags: Option<Vec<String>>,
    /// Tags to add. Tags that exist already stay. Not together with `tags`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schema(max_items = 32)]
    pub add_tags: Vec<String>,
    /// Tags to remove. Tags that do not exist are ignored. Not together with `tags`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schema(max_items = 32)]
    pub remove_tags: Vec<String>,
    /// Names that shall stand for this checkpoint, such as `champion`. Each stands for one checkpoint, so another that
    /// has it loses it. Only checkpoints have aliases.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schema(max_items = 32, example = json!(["champion"]))]
    pub add_aliases: Vec<String>,
    /// Aliases to remove from this checkpoint. Those that it does not have are ignored.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schema(max_items = 32)]
    pub remove_aliases: Vec<String>,
}

/// A text field of a merge patch.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum TextChange {
    /// The field is left out, so the text stays.
    #[default]
    Nothing,
    /// The field is `null`, so the text is removed.
    Remove,
    /// The text replaces the present one.
    Set(String),
}

impl TextChange {
    /// Whether the text stays as it is.
    pub const fn is_nothing(&self) -> bool {
        matches!(self, Self::Nothing)
    }
}

impl Serialize for TextChange {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Nothing | Self::Remove => serializer.serialize_none(),
            Self::Set(text) => serializer.serialize_str(text),
        }
    }
}

impl<'de> Deserialize<'de> for TextChange {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Ok(Option::deserialize(deserializer)?.map_or(Self::Remove, Self::Set))
    }
}

/// Reads `null` as no tags.
fn all_tags<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Vec<String>>, D::Error> {
    Ok(Some(Option::deserialize(deserializer)?.unwrap_or_default()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_out_is_told_from_null() {
        let change: LabelChange = serde_json::from_str(r#"{"name": null, "tags": null}"#).unwrap();
        let expected =
            LabelChange { name: TextChange::Remove, tags: Some(vec![]), ..LabelChange::default() };
        assert_eq!(change, expected);
        assert_eq!(serde_json::to_string(&change).unwrap(), r#"{"name":null,"tags":[]}"#);
        let nothing: LabelChange = serde_json::from_str("{}").unwrap();
        assert_eq!(nothing, LabelChange::default());
        assert_eq!(serde_json::to_string(&nothing).unwrap(), "{}");
    }
}

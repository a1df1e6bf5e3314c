//! Labels: what people call things, say of them and sort them by.

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use utoipa::ToSchema;

/// A change of name, note and tags: a merge patch (RFC 7396), in which what is left out stays and `null` removes. `add_tags` and
/// `remove_tags` change single tags, so that two people can do that at once.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LabelChange {
    /// One line. Without a name of its own a job has that of its spec, and a run or a dataset that of its job.
    #[serde(default, skip_serializing_if = "TextChange::is_nothing")]
    #[schema(value_type = Option<String>, min_length = 1, max_length = 200, example = "baseline, 3 seeds")]
    pub name: TextChange,
    /// Markdown, kept and shown as text.
    #[serde(default, skip_serializing_if = "TextChange::is_nothing")]
    #[schema(value_type = Option<String>, min_length = 1, max_length = 10_000)]
    pub note: TextChange,
    /// All tags, in place of those that are there.
    #[serde(default, deserialize_with = "all_tags", skip_serializing_if = "Option::is_none")]
    #[schema(max_items = 32, example = json!(["baseline", "sweep/3"]))]
    pub tags: Option<Vec<String>>,
    /// Tags that are added, where they are not there yet. Not beside `tags`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schema(max_items = 32)]
    pub add_tags: Vec<String>,
    /// Tags that are removed, where they are there. Not beside `tags`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schema(max_items = 32)]
    pub remove_tags: Vec<String>,
}

/// A field of a merge patch that is a text.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum TextChange {
    /// It stays: the field is left out.
    #[default]
    Nothing,
    /// It goes: the field is `null`.
    Remove,
    Set(String),
}

impl TextChange {
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

/// `null` is no tags.
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

//! Runs as MLflow's REST API has them, on both sides of an export: torqued's server shows its runs in the same shape.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

#[derive(Debug, Deserialize)]
pub struct Run {
    pub info: RunInfo,
    #[serde(default)]
    pub data: RunData,
}

#[derive(Debug, Deserialize)]
pub struct RunInfo {
    pub run_id: String,
    #[serde(default)]
    pub run_name: String,
    pub status: String,
    #[serde(default, deserialize_with = "optional_integer")]
    pub start_time: Option<i64>,
    #[serde(default, deserialize_with = "optional_integer")]
    pub end_time: Option<i64>,
    #[serde(default)]
    pub artifact_uri: String,
    #[serde(default)]
    pub lifecycle_stage: String,
}

#[derive(Debug, Default, Deserialize)]
pub struct RunData {
    /// The latest point of each key.
    #[serde(default)]
    pub metrics: Vec<Point>,
    #[serde(default)]
    pub params: Vec<Pair>,
    #[serde(default)]
    pub tags: Vec<Pair>,
}

/// A point of a metric.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Point {
    pub key: String,
    #[serde(deserialize_with = "double", serialize_with = "write_double")]
    pub value: f64,
    /// Milliseconds since 1970.
    #[serde(deserialize_with = "integer")]
    pub timestamp: i64,
    #[serde(default, deserialize_with = "integer")]
    pub step: i64,
}

/// A param or a tag.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub struct Pair {
    pub key: String,
    #[serde(default)]
    pub value: String,
}

/// A file or a folder of a run.
#[derive(Debug, Deserialize)]
pub struct FileInfo {
    pub path: String,
    #[serde(default)]
    pub is_dir: bool,
    #[serde(default, deserialize_with = "optional_integer")]
    pub file_size: Option<i64>,
}

impl Point {
    /// The point's identity: MLflow's database keeps the largest finite double in place of an infinite value, and 0 for NaN.
    pub fn identity(&self) -> (i64, i64, u64) {
        let value =
            if self.value.is_nan() { f64::NAN } else { self.value.clamp(f64::MIN, f64::MAX) };
        (self.step, self.timestamp, value.to_bits())
    }
}

/// Integers of 64 bits are numbers, or texts as JSON of protobuf has them.
#[derive(Deserialize)]
#[serde(untagged)]
enum Integer {
    Number(i64),
    Text(String),
}

impl Integer {
    fn read<E: serde::de::Error>(self) -> Result<i64, E> {
        match self {
            Self::Number(number) => Ok(number),
            Self::Text(text) => text.parse().map_err(E::custom),
        }
    }
}

fn integer<'de, D: Deserializer<'de>>(deserializer: D) -> Result<i64, D::Error> {
    Integer::deserialize(deserializer)?.read()
}

fn optional_integer<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<i64>, D::Error> {
    Option::<Integer>::deserialize(deserializer)?.map(Integer::read).transpose()
}

/// Doubles are numbers, or the words of JSON of protobuf for values that are not finite.
#[derive(Deserialize)]
#[serde(untagged)]
enum Double {
    Number(f64),
    Text(String),
}

fn double<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    match Double::deserialize(deserializer)? {
        Double::Number(number) => Ok(number),
        Double::Text(text) => text.parse().map_err(serde::de::Error::custom),
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands it over")]
fn write_double<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    match *value {
        nan if nan.is_nan() => serializer.serialize_str("NaN"),
        f64::INFINITY => serializer.serialize_str("Infinity"),
        f64::NEG_INFINITY => serializer.serialize_str("-Infinity"),
        finite => serializer.serialize_f64(finite),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn point(value: &serde_json::Value) -> Point {
        serde_json::from_value(json!({"key": "k", "value": value, "timestamp": "12", "step": 3}))
            .unwrap()
    }

    #[test]
    fn values_that_are_not_finite_go_there_and_back() {
        for word in ["NaN", "Infinity", "-Infinity"] {
            let written = serde_json::to_value(point(&json!(word))).unwrap();
            assert_eq!(written["value"], word);
        }
        let third = 1.0 / 3.0;
        assert_eq!(serde_json::to_value(point(&json!(third))).unwrap()["value"], third);
    }

    #[test]
    fn an_infinite_value_is_the_largest_one_that_mlflow_keeps() {
        assert_eq!(point(&json!("Infinity")).identity(), point(&json!(f64::MAX)).identity());
        assert_eq!(point(&json!("NaN")).identity(), point(&json!("NaN")).identity());
        assert_ne!(point(&json!(0.5)).identity(), point(&json!(0.25)).identity());
    }
}

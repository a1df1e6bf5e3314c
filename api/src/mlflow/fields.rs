//! The fields of a request. MLflow's clients send them as JSON or, with GET, in the query.

use std::borrow::Cow;

use axum::extract::{FromRef, FromRequest, Query, Request as HttpRequest};
use axum::http::Method;
use serde_json::{Map, Value};
use tokio::sync::OwnedSemaphorePermit;
use tokio::task::spawn_blocking;

use super::MlflowError;
use crate::checks::Checks;
use crate::error::ApiError;
use crate::extract::JsonBytes;

/// All fields of a request. Unknown fields are ignored, as on MLflow's own server.
pub struct Request {
    fields: Map<String, Value>,
    /// The place of a large body among those that are checked. The fields take many times its
    /// bytes, so the place is kept as long as they are.
    _place: Option<OwnedSemaphorePermit>,
}

/// The fields of a request, or of an object in one of its lists.
#[derive(Clone, Copy)]
pub struct Fields<'a> {
    map: &'a Map<String, Value>,
    /// The list that contains the object, and its index there.
    within: Option<(&'static str, usize)>,
}

impl Request {
    pub const fn fields(&self) -> Fields<'_> {
        Fields { map: &self.fields, within: None }
    }
}

impl<S: Send + Sync> FromRequest<S> for Request
where
    Checks: FromRef<S>,
{
    type Rejection = MlflowError;

    async fn from_request(request: HttpRequest, state: &S) -> Result<Self, MlflowError> {
        if request.method() == Method::GET || request.method() == Method::HEAD {
            let pairs = Query::<Vec<(String, String)>>::try_from_uri(request.uri());
            let Query(pairs) =
                pairs.map_err(|error| ApiError::Query { reason: error.body_text() })?;
            return Ok(Self { fields: of_query(pairs), _place: None });
        }
        let JsonBytes(bytes) =
            JsonBytes::<{ crate::limits::BODY_BYTES }>::from_request(request, state).await?;
        let place = Checks::from_ref(state).place(bytes.len()).await?;
        let read = move || spec::read_json::<Value>(&bytes).map_err(ApiError::Json);
        let value = match &place {
            None => read()?,
            Some(_) => spawn_blocking(read).await.map_err(|_| ApiError::Internal)??,
        };
        match value {
            Value::Object(fields) => Ok(Self { fields, _place: place }),
            other => Err(MlflowError::invalid("the body", &other.to_string(), "a JSON object")),
        }
    }
}

/// The fields of a query. A field that comes more than once is a list.
fn of_query(pairs: Vec<(String, String)>) -> Map<String, Value> {
    let mut fields = Map::new();
    for (name, value) in pairs {
        match fields.get_mut(&name) {
            None => drop(fields.insert(name, Value::String(value))),
            Some(Value::Array(values)) => values.push(Value::String(value)),
            Some(first) => *first = Value::Array(vec![first.take(), Value::String(value)]),
        }
    }
    fields
}

impl<'a> Fields<'a> {
    /// The field's name in messages, such as `metrics[3].value`.
    pub fn path(&self, name: &str) -> String {
        match self.within {
            None => name.to_owned(),
            Some((list, place)) => format!("{list}[{place}].{name}"),
        }
    }

    /// A field's value. `null` counts as missing.
    fn value(&self, name: &str) -> Option<&'a Value> {
        self.map.get(name).filter(|value| !value.is_null())
    }

    fn invalid(&self, name: &str, value: &Value, allowed: &str) -> MlflowError {
        let value = value.as_str().map_or_else(|| Cow::Owned(value.to_string()), Cow::Borrowed);
        MlflowError::invalid(&self.path(name), &value, allowed)
    }

    /// A text with at most `most` characters. No database can store the character NUL.
    pub fn text(&self, name: &str, most: usize) -> Result<Option<&'a str>, MlflowError> {
        let Some(value) = self.value(name) else { return Ok(None) };
        match value.as_str() {
            // There are at most as many characters as bytes, and bytes are counted faster.
            Some(text)
                if (text.len() <= most || text.chars().count() <= most) && !text.contains('\0') =>
            {
                Ok(Some(text))
            }
            _ => {
                let allowed = format!("a text of {most} characters at most, without NUL");
                Err(self.invalid(name, value, &allowed))
            }
        }
    }

    pub fn required_text(&self, name: &str, most: usize) -> Result<&'a str, MlflowError> {
        let text = self.text(name, most)?.filter(|text| !text.is_empty());
        text.ok_or_else(|| MlflowError::missing(&self.path(name)))
    }

    /// An integer of 64 bits, which protobuf's JSON writes as text.
    pub fn integer(&self, name: &str) -> Result<Option<i64>, MlflowError> {
        let Some(value) = self.value(name) else { return Ok(None) };
        let number = match value {
            Value::String(text) => text.parse().ok(),
            value => value.as_i64(),
        };
        let allowed = "a whole number of 64 bits";
        number.map(Some).ok_or_else(|| self.invalid(name, value, allowed))
    }

    /// A double, or a word of protobuf's JSON for a number that is not finite.
    pub fn number(&self, name: &str) -> Result<Option<f64>, MlflowError> {
        let Some(value) = self.value(name) else { return Ok(None) };
        let number = match value {
            Value::String(text) => match text.as_str() {
                "NaN" => Some(f64::NAN),
                "Infinity" => Some(f64::INFINITY),
                "-Infinity" => Some(f64::NEG_INFINITY),
                text => text.parse().ok(),
            },
            value => value.as_f64(),
        };
        let allowed = "a number, \"NaN\", \"Infinity\" or \"-Infinity\"";
        number.map(Some).ok_or_else(|| self.invalid(name, value, allowed))
    }

    /// The objects of a list with at most `most` items. Empty without the field.
    pub fn objects(&self, name: &'static str, most: usize) -> Result<Vec<Fields<'a>>, MlflowError> {
        let object = |(place, value): (usize, &'a Value)| match value.as_object() {
            Some(map) => Ok(Fields { map, within: Some((name, place)) }),
            None => Err(self.invalid(name, value, "a list of objects")),
        };
        self.list(name, most)?.iter().enumerate().map(object).collect()
    }

    /// The texts of a list with at most `most` items. Empty without the field.
    pub fn texts(&self, name: &'static str, most: usize) -> Result<Vec<&'a str>, MlflowError> {
        // In a query, a list with one item looks like a text.
        if let Some(text) = self.value(name).and_then(Value::as_str) {
            return Ok(vec![text]);
        }
        let text = |value: &'a Value| {
            value.as_str().ok_or_else(|| self.invalid(name, value, "a list of texts"))
        };
        self.list(name, most)?.iter().map(text).collect()
    }

    fn list(&self, name: &'static str, most: usize) -> Result<&'a [Value], MlflowError> {
        match self.value(name) {
            None => Ok(&[]),
            Some(Value::Array(values)) if values.len() <= most => Ok(values),
            Some(Value::Array(values)) => {
                let found = format!("{} items", values.len());
                Err(MlflowError::invalid(name, &found, &format!("{most} items at most")))
            }
            Some(other) => Err(self.invalid(name, other, "a list")),
        }
    }
}

//! The parameters of lists.

use std::marker::PhantomData;

use serde::Deserialize;
use utoipa::IntoParams;
use utoipa::openapi::path::{Parameter, ParameterBuilder, ParameterIn};
use utoipa::openapi::schema::{ArrayBuilder, KnownFormat, ObjectBuilder, SchemaFormat, Type};
use utoipa::openapi::{RefOr, Required, Schema};
use wire::{List, Listed};

use crate::app::Paging;
use crate::app::labels::TAG_PATTERN;
use crate::app::listing::has_errors;
use crate::error::ApiError;
use crate::limits::{PAGE_DEFAULT, PAGE_MAXIMUM, SEARCH_CHARACTERS, TAGS};

/// Parameters of a list without filters.
#[derive(Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct ListParameters {
    /// Largest number of items, 1 to 500; 50 by default.
    pub limit: Option<u32>,
    /// Only items with a smaller id.
    pub before: Option<i64>,
}

impl ListParameters {
    pub fn paging(&self) -> Result<Paging, ApiError> {
        Paging::new(self.limit, self.before)
    }
}

/// Documents the parameters of the list of `T` with the same limits that are checked.
pub struct Parameters<T>(PhantomData<T>);

impl<T: Listed> IntoParams for Parameters<T> {
    fn into_params(_: impl Fn() -> Option<ParameterIn>) -> Vec<Parameter> {
        parameters(&T::LIST)
    }
}

/// The tags for a submitted job.
pub struct TagParameters;

impl IntoParams for TagParameters {
    fn into_params(_: impl Fn() -> Option<ParameterIn>) -> Vec<Parameter> {
        let about =
            "A tag for the job and, for a pipeline, for its jobs. It may be given several times.";
        vec![parameter("tag", about, tags())]
    }
}

fn tags() -> RefOr<Schema> {
    let tag = ObjectBuilder::new().schema_type(Type::String).pattern(Some(TAG_PATTERN));
    ArrayBuilder::new().items(tag).max_items(Some(TAGS)).into()
}

fn parameter(name: &str, description: &str, schema: RefOr<Schema>) -> Parameter {
    ParameterBuilder::new()
        .name(name)
        .parameter_in(ParameterIn::Query)
        .required(Required::False)
        .description(Some(description))
        .schema(Some(schema))
        .build()
}

fn parameters(list: &List) -> Vec<Parameter> {
    let text = || ObjectBuilder::new().schema_type(Type::String);
    let number = || ObjectBuilder::new().schema_type(Type::Integer);
    let moment = || text().format(Some(SchemaFormat::KnownFormat(KnownFormat::DateTime))).into();
    let one_of = |values: &[&'static str]| text().enum_values(Some(values.to_vec())).into();
    let mut parameters = Vec::new();
    let mut add = |name: &str, description: &str, schema: RefOr<Schema>| {
        parameters.push(parameter(name, description, schema));
    };
    if !list.kinds.is_empty() {
        add("kind", "Only items of jobs of this kind.", one_of(list.kinds));
    }
    if !list.states.is_empty() {
        add("state", "Only items in this state.", one_of(list.states));
    }
    let mut searched = "the name";
    if list.has_labels {
        let about = "Only items with this tag, on the item or on its job. With several tags, with all of them.";
        add("tag", about, tags());
        searched = "the name or the note of the item or of its job";
    }
    let about = format!(
        "Only items with this text in {searched}, ignoring case. No character is a wildcard."
    );
    add("text", &about, text().min_length(Some(1)).max_length(Some(SEARCH_CHARACTERS)).into());
    if has_errors(list) {
        let about = "Only items whose jobs read the dataset with this id. Errors on different data are not comparable.";
        add(
            "dataset",
            about,
            number().format(Some(SchemaFormat::KnownFormat(KnownFormat::Int64))).into(),
        );
    }
    add("since", "Only items created at this time or later, RFC 3339.", moment());
    add("until", "Only items created before this time, RFC 3339.", moment());
    let about = "The order; `-` before it reverses it. Equal items are sorted by id. `-created` by default.";
    add("sort", about, text().enum_values(Some(list.orders())).into());
    let about = format!("Largest number of items, 1 to {PAGE_MAXIMUM}; {PAGE_DEFAULT} by default.");
    add(
        "limit",
        &about,
        number().format(Some(SchemaFormat::KnownFormat(KnownFormat::Int32))).into(),
    );
    let about = "The beginning of the page: the `next` of the page before, in this list with the same `sort`.";
    add("cursor", about, text().into());
    let about = "Only items with a smaller id.";
    add(
        "before",
        about,
        number().format(Some(SchemaFormat::KnownFormat(KnownFormat::Int64))).into(),
    );
    parameters
}

//! MLflow's REST API: its requests, entities, errors, filters and limits. Nothing here uses the
//! store.

pub mod entities;
mod error;
mod fields;
pub mod filter;
mod identifier;
pub mod limits;
pub mod order;
mod scan;
mod translation;

pub use error::{ErrorCode, MlflowError};
pub use fields::{Fields, Request};
pub use identifier::{Attribute, Datum, Field, is_key};
pub use translation::translate;

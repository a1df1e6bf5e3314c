//! HTTP: routes, authentication, OpenAPI, downloads and the page.
//!
//! A handler parses, calls [`app`], and answers. `app` implements the operations on jobs, datasets
//! and other resources with the store. Nothing here runs a job, writes SQL or touches a file path.

mod access;
mod admission;
mod app;
mod charts;
mod checks;
mod connections;
mod download;
mod error;
mod extract;
mod guard;
pub mod limits;
pub mod live;
mod mlflow;
mod pace;
mod page;
mod parameters;
mod range;
mod relative;
mod remote;
mod request_id;
mod routes;
mod server;
mod stream;
mod upload;

pub use access::credentials::digest as token_digest;
pub use access::secret::{is_hard_to_guess, token as new_token};
pub use app::tokens::{TOKEN_NAMES, is_token_name};
pub use app::{App, Options};
pub use connections::Listener;
pub use page::paths as page_paths;
pub use remote::TrustedProxy;
pub use routes::{openapi, router};
pub use server::{ServeError, serve};

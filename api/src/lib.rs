//! HTTP: routes, authentication, OpenAPI, downloads and the page.
//!
//! A handler parses, calls [`app`], and answers. `app` implements the operations on jobs, datasets
//! and other resources with the store. Nothing here runs a job, writes SQL or touches a file path.
//!
//! # Who may ask
//!
//! `connections` accepts TCP or a socket in the file system, with deadlines for what a client sends
//! and accepts. `admission` gives each request a place. All places together, with those of
//! downloads and streams of events, are fewer than the connections, so a new request always finds a
//! connection that gives up its place. A request that anybody may send takes its place after its
//! body has arrived. `access` finds out who calls. An operation names its scope in the OpenAPI
//! document, and the middleware reads it there; one without a scope needs `admin` unless it only
//! reads. A form of the page needs the scope of the operation of the same path. Requests that need
//! more than `read` go into the audit log after their answer.
//!
//! # Answers
//!
//! A cursor of a list is a place in one order of one list; the words that a list allows are
//! declared once, for checks and document. A sent file is a list of contents, objects or bytes in
//! memory. A trajectory is read out of its row group on a blocking thread, a few requests at a
//! time; shards that were read last stay open, because opening one checks all its bytes. The
//! summary of a dataset is merged from the results of its tasks and never computed on a request.
//! Large answers and bodies are parsed on threads that may block, a few at a time.
//!
//! A batch of MLflow's is one transaction that first locks its run. No worker, fence or job has to
//! do with tracked runs, and clients give their times.

#![warn(missing_docs)]

mod access;
mod admission;
mod aliases;
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

pub use access::credentials::{digest as token_digest, is_hard_to_guess, new_token};
pub use app::labels::is_alias;
pub use app::tokens::{TOKEN_NAMES, is_token_name};
pub use app::{App, Options};
pub use connections::Listener;
pub use page::paths as page_paths;
pub use remote::TrustedProxy;
pub use routes::{openapi, router};
pub use server::{ServeError, serve};

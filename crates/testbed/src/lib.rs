//! Private servers for tests and benchmarks, separate from those of the machine: a PostgreSQL that
//! listens on a socket in a temporary folder.

#![warn(missing_docs)]

mod postgres;

pub use postgres::{Cluster, Durability, TestDatabase};

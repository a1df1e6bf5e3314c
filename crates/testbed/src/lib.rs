//! Private servers for tests and benchmarks, separate from those of the machine: a PostgreSQL that
//! listens on a socket in a temporary folder.

mod postgres;

pub use postgres::{Cluster, Durability, TestDatabase};

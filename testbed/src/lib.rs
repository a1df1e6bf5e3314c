//! Private servers that tests and benchmarks run against, never those of the machine: a PostgreSQL that listens on a
//! socket in a temporary folder.

mod postgres;

pub use postgres::{Cluster, Durability, TestDatabase};

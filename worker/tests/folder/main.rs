//! Datasets in folders: made, completed, verified, and damaged in every way.

#![expect(clippy::unwrap_used, reason = "tests")]

mod columns;
mod completing;
mod fixture;
mod pinned;
mod verifying;

//! Predictions over HTTP and WebSocket, computed by real models.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod fixture;
mod predictions;
mod streams;
mod torques;
mod warnings;

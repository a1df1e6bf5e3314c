//! Pages of lists without filters: newest first, and tasks in the order in which they run.

use std::fmt::Display;
use std::io;

use serde::Serialize;

use crate::error::ApiError;
use crate::limits::{PAGE_DEFAULT, PAGE_MAXIMUM};

/// The requested part of a list.
#[derive(Clone, Copy, Debug)]
pub struct Paging {
    /// Largest number of items.
    pub limit: u32,
    /// Only items with a smaller id.
    pub before: Option<i64>,
}

/// The requested part of a job's tasks.
#[derive(Clone, Copy, Debug)]
pub struct TaskPaging {
    /// Largest number of tasks.
    pub limit: u32,
    /// Only tasks that run after this one.
    pub after: Option<i64>,
}

impl From<Paging> for store::Page {
    fn from(paging: Paging) -> Self {
        Self { before: paging.before, limit: paging.limit }
    }
}

impl Paging {
    /// # Errors
    /// When `limit` is not between 1 and [`PAGE_MAXIMUM`].
    pub fn new(limit: Option<u32>, before: Option<i64>) -> Result<Self, ApiError> {
        Ok(Self { limit: checked(limit)?, before })
    }

    /// The `before` of the following page, if this page has `found` items and its last id is
    /// `last`.
    pub fn next(self, found: usize, last: Option<i64>) -> Option<i64> {
        last.filter(|_| is_full(found, self.limit))
    }
}

impl TaskPaging {
    /// # Errors
    /// When `limit` is not between 1 and [`PAGE_MAXIMUM`].
    pub fn new(limit: Option<u32>, after: Option<i64>) -> Result<Self, ApiError> {
        Ok(Self { limit: checked(limit)?, after })
    }

    /// The `after` of the following page, if this page has `found` tasks and its last id is `last`.
    pub fn next(self, found: usize, last: Option<i64>) -> Option<i64> {
        last.filter(|_| is_full(found, self.limit))
    }
}

/// # Errors
/// When `limit` is not between 1 and [`PAGE_MAXIMUM`].
pub fn checked(limit: Option<u32>) -> Result<u32, ApiError> {
    let limit = limit.unwrap_or(PAGE_DEFAULT);
    if !(1..=PAGE_MAXIMUM).contains(&limit) {
        return Err(limit_error(limit));
    }
    Ok(limit)
}

pub fn limit_error(limit: impl Display) -> ApiError {
    ApiError::parameter("limit", limit, format!("1 to {PAGE_MAXIMUM}"))
}

/// Whether the page is full, so more items may follow.
fn is_full(found: usize, limit: u32) -> bool {
    u32::try_from(found).is_ok_and(|found| found >= limit)
}

/// Bytes of a value as JSON.
pub fn json_bytes(value: &impl Serialize) -> usize {
    let mut counter = Counter(0);
    // Counting cannot fail, and neither can values of the API.
    let _ = serde_json::to_writer(&mut counter, value);
    counter.0
}

/// Counts the bytes that are written.
struct Counter(usize);

impl io::Write for Counter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0 += bytes.len();
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

//! The result of an import.

use serde::Deserialize;
use wire::{ImportCounts, Job};

use crate::app::App;
use crate::error::ApiError;
use crate::page::parts::Fact;
use crate::page::text;

/// The counts and warnings of an import; `None` until it has ended.
pub async fn counts(app: &App, import: &Job) -> Result<Option<ImportCounts>, ApiError> {
    let result = app.sole_results(&[import.id]).await?.remove(&import.id);
    let counts = result.as_ref().and_then(|result| result.get("import"));
    Ok(counts.and_then(|counts| ImportCounts::deserialize(counts).ok()))
}

pub fn facts(counts: &ImportCounts) -> Vec<Fact> {
    let too_short = match counts.dropped_recordings {
        0 => format!("in {} rows", text::count(counts.rows)),
        dropped => format!("{} of them too short", text::count(dropped)),
    };
    let left_over = text::count(counts.dropped_samples);
    let mut facts = vec![
        Fact::new("Recordings", text::count(counts.recordings), too_short),
        Fact::new("Left over", left_over, "samples in no trajectory"),
    ];
    if counts.filtered_recordings > 0 {
        let filtered = text::count(counts.filtered_recordings);
        facts.push(Fact::new("Filtered", filtered, "recordings, before samples were left out"));
    }
    facts
}

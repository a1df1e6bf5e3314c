//! What became of a file that was imported.

use serde::Deserialize;
use wire::{ImportCounts, Job};

use crate::app::App;
use crate::error::ApiError;
use crate::page::parts::Fact;
use crate::page::text;

/// Nothing until the import has ended.
pub async fn facts(app: &App, import: &Job) -> Result<Vec<Fact>, ApiError> {
    let tasks = app.tasks(import.id).await?;
    let result = tasks.first().and_then(|task| task.result.as_ref()?.get("import"));
    let counts = result.and_then(|counts| ImportCounts::deserialize(counts).ok());
    Ok(counts.map_or(Vec::new(), |counts| {
        let too_short = match counts.dropped_recordings {
            0 => format!("in {} rows", text::count(counts.rows)),
            dropped => format!("{} of them too short", text::count(dropped)),
        };
        let left_over = text::count(counts.dropped_samples);
        vec![
            Fact::new("Recordings", text::count(counts.recordings), too_short),
            Fact::new("Left over", left_over, "samples in no trajectory"),
        ]
    }))
}

//! The result of an import.

use serde::Deserialize;
use wire::{ImportCounts, Job, LogCheck};

use crate::app::App;
use crate::error::ApiError;
use crate::page::parts::Fact;
use crate::page::text;

/// The findings of an import about its file.
pub struct Imported {
    /// Counts and warnings.
    pub counts: ImportCounts,
    /// The torques beside those of the robot, if the import names one.
    pub check: Option<LogCheck>,
}

impl Imported {
    /// `None` until the import has ended.
    pub async fn of(app: &App, import: &Job) -> Result<Option<Self>, ApiError> {
        let result = app.sole_results(&[import.id]).await?.remove(&import.id);
        Ok(result.and_then(|result| {
            let counts = ImportCounts::deserialize(result.get("import")?).ok()?;
            let check = result.get("check").and_then(|check| LogCheck::deserialize(check).ok());
            Some(Self { counts, check })
        }))
    }
}

pub fn facts(counts: &ImportCounts) -> Vec<Fact> {
    let too_short = match counts.dropped_recordings {
        0 => format!("in {}", text::counted(counts.rows, "row")),
        dropped => format!("{} of them too short", text::count(dropped)),
    };
    let left_over = text::count(counts.dropped_samples);
    let samples = if counts.dropped_samples == 1 { "sample" } else { "samples" };
    let mut facts = vec![
        Fact::new("Recordings", text::count(counts.recordings), too_short),
        Fact::new("Left over", left_over, format!("{samples} in no trajectory")),
    ];
    if counts.filtered_recordings > 0 {
        let recordings = if counts.filtered_recordings == 1 { "recording" } else { "recordings" };
        let note = format!("{recordings}, before samples were left out");
        facts.push(Fact::new("Filtered", text::count(counts.filtered_recordings), note));
    }
    facts
}

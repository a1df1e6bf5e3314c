//! The results of a control job on its page: figures, and numbers with their intervals.

use reports::{Table, closed_loop};
use wire::{Job, Warning};

use crate::app::App;
use crate::error::ApiError;

/// Figures and tables of a control job.
pub struct ClosedLoop {
    pub setting: String,
    /// Sentences about data outside the checkpoints' training data.
    pub warnings: Vec<String>,
    /// Figures of all robots, then of the first robot.
    pub figures: Vec<FigureLink>,
    pub tables: Vec<Table>,
}

pub struct FigureLink {
    pub url: String,
    pub says: &'static str,
    pub height: u32,
}

impl ClosedLoop {
    /// `None` for a job without a report.
    pub async fn of(app: &App, job: &Job) -> Result<Option<Self>, ApiError> {
        let Some(run) = job.run else { return Ok(None) };
        let Some(report) = app.report(run).await? else { return Ok(None) };
        let artifacts = app.run(run).await?.artifacts;
        let figures = [
            (
                "tracking.svg",
                "RMS tracking error over time, a line for each controller. The table below holds \
                 the means.",
                420,
            ),
            (
                "robot-00.svg",
                "Positions of joints 1, 4 and 7 of the first robot beside their path, a line for \
                 each controller.",
                780,
            ),
        ];
        let figures = figures.into_iter().filter_map(|(name, says, height)| {
            let artifact = artifacts.iter().find(|artifact| artifact.name == name)?;
            Some(FigureLink { url: artifact.url.clone(), says, height })
        });
        Ok(Some(Self {
            setting: closed_loop::setting(&report),
            warnings: Warning::sentences(&report.warnings, report.robots, "robots"),
            figures: figures.collect(),
            tables: closed_loop::tables(&report),
        }))
    }
}

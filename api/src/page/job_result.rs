//! The results of a job on its page, for kinds without a page of their own: sentences, figures and
//! tables.

use reports::{Table, closed_loop, identification};
use spec::JobKind;
use wire::{Artifact, ControlReport, IdentificationReport, Job, Warning};

use crate::app::App;
use crate::error::ApiError;
use crate::page::parts::Link;

/// Sentences, figures and tables.
pub struct JobResult {
    pub setting: String,
    pub warnings: Vec<String>,
    pub links: Vec<Link>,
    pub figures: Vec<FigureLink>,
    pub tables: Vec<Table>,
}

pub struct FigureLink {
    pub url: String,
    pub title: &'static str,
    pub says: &'static str,
    pub height: u32,
}

/// A figure that a job may leave: its file, its title, what it shows, and its height in px.
type KnownFigure = (&'static str, &'static str, &'static str, u32);

const OF_CONTROL: [KnownFigure; 2] = [
    (
        "tracking.svg",
        "Tracking error over time",
        "RMS tracking error over time, a line for each controller. The table above holds the means.",
        420,
    ),
    (
        "robot-00.svg",
        "The first robot beside its path",
        "Positions of joints 1, 4 and 7 of the first robot beside their path, a line for each \
         controller.",
        780,
    ),
];

/// Both have a panel for each joint.
fn of_identification(joints: usize) -> [KnownFigure; 2] {
    const PANEL: u32 = 260;

    let height = PANEL * u32::try_from(joints).unwrap_or(1);
    [
        (
            "motion.svg",
            "Measured and simulated motion",
            "Measured positions beside simulations of the described and the identified arm. Each \
             simulation begins anew every 1.33 s.",
            height,
        ),
        (
            "torques.svg",
            "Measured and computed torques",
            "Measured torques beside those that the described and the identified arm need for the \
             measured motion.",
            height,
        ),
    ]
}

impl JobResult {
    /// `None` for a job without a report, and for kinds that show their results elsewhere.
    pub async fn of(app: &App, job: &Job) -> Result<Option<Self>, ApiError> {
        let Some(run) = job.run else { return Ok(None) };
        let result = match job.kind {
            JobKind::Control => app.report(run).await?.as_ref().map(Self::of_control),
            JobKind::Identify => match app.report(run).await? {
                Some(report) => Some(Self::of_identification(app, &report).await?),
                None => None,
            },
            _ => None,
        };
        let Some((result, figures)) = result else { return Ok(None) };
        let artifacts = app.run(run).await?.artifacts;
        let figures = figures.iter().filter_map(|figure| FigureLink::of(figure, &artifacts));
        Ok(Some(Self { figures: figures.collect(), ..result }))
    }

    fn of_control(report: &ControlReport) -> (Self, [KnownFigure; 2]) {
        let result = Self {
            setting: closed_loop::setting(report),
            warnings: Warning::sentences(&report.warnings, report.robots, "robots"),
            links: Vec::new(),
            figures: Vec::new(),
            tables: closed_loop::tables(report),
        };
        (result, OF_CONTROL)
    }

    async fn of_identification(
        app: &App,
        report: &IdentificationReport,
    ) -> Result<(Self, [KnownFigure; 2]), ApiError> {
        let robot = app.robot_with(report.robot).await?;
        let link = |robot: i64| Link::new(format!("/robots/{robot}"), "the identified arm");
        let result = Self {
            setting: identification::setting(report),
            warnings: identification::warnings(report),
            links: robot.into_iter().map(link).collect(),
            figures: Vec::new(),
            tables: identification::tables(report),
        };
        Ok((result, of_identification(report.arm.torques.len())))
    }
}

impl FigureLink {
    /// `None` if the job did not leave the figure.
    fn of((name, title, says, height): &KnownFigure, artifacts: &[Artifact]) -> Option<Self> {
        let artifact = artifacts.iter().find(|artifact| artifact.name == *name)?;
        Some(Self { url: artifact.url.clone(), title, says, height: *height })
    }
}

//! The results of a control job on its page: figures, and numbers with their intervals.

use wire::{ControlReport, ControllerSummary, Job, Warning};

use crate::app::App;
use crate::error::ApiError;
use crate::page::text;

/// Figures and tables of a control job.
pub struct ClosedLoop {
    pub setting: String,
    /// Sentences about data outside the checkpoints' training data.
    pub warnings: Vec<String>,
    /// Figures of all robots, then of the first robot.
    pub figures: Vec<FigureLink>,
    pub controllers: Vec<ControllerRow>,
    pub paired: Vec<PairedRow>,
}

pub struct FigureLink {
    pub url: String,
    pub says: &'static str,
    pub height: u32,
}

pub struct ControllerRow {
    pub name: String,
    pub failure: String,
    pub rms: String,
    pub interval: String,
    pub peak: String,
    pub joints: String,
    pub torque: String,
    pub beyond: String,
    pub plan: String,
}

pub struct PairedRow {
    pub controller: String,
    pub against: String,
    pub mean: String,
    pub interval: String,
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
            setting: setting(&report),
            warnings: Warning::sentences(&report.warnings, report.robots, "robots"),
            figures: figures.collect(),
            controllers: report.controllers.iter().map(ControllerRow::new).collect(),
            paired: report
                .paired
                .iter()
                .map(|pair| PairedRow {
                    controller: pair.controller.clone(),
                    against: pair.against.clone(),
                    mean: text::signed_degrees(pair.difference_deg.mean),
                    interval: text::signed_interval(pair.difference_deg),
                })
                .collect(),
        }))
    }
}

/// The tracking errors in one line.
pub fn headline(report: &ControlReport) -> String {
    let of = |controller: &ControllerSummary| match controller.rms_deg {
        Some(rms) => format!("{} {}°", controller.info.name, text::degrees(rms.mean)),
        None => format!("{} failed", controller.info.name),
    };
    report.controllers.iter().map(of).collect::<Vec<_>>().join(", ")
}

fn setting(report: &ControlReport) -> String {
    let planner = &report.planner;
    let seconds = |samples: u32| text::value(f64::from(samples) / report.rate_hz);
    format!(
        "{} robots, each excited for {} samples and then controlled for {} s at {} Hz. Every {} \
         samples ({} s) a plan of {} samples ({} s) is made from {} × {} foreseen torque sequences.",
        text::count(report.robots),
        report.context,
        seconds(report.steps),
        report.rate_hz,
        planner.replan_every,
        seconds(planner.replan_every),
        planner.horizon,
        seconds(planner.horizon),
        planner.iterations,
        planner.samples,
    )
}

impl ControllerRow {
    fn new(controller: &ControllerSummary) -> Self {
        let number = |value: Option<f64>| value.map_or_else(none, text::degrees);
        let failure = controller.failure.as_ref();
        let joints = controller.joint_rms_deg.as_ref().map(|joints| {
            joints.iter().map(|rms| text::degrees(*rms)).collect::<Vec<_>>().join(" ")
        });
        Self {
            name: controller.info.name.clone(),
            failure: failure.map_or(String::new(), |reason| {
                format!("failed on {} robots: {reason}", controller.failed)
            }),
            rms: number(controller.rms_deg.map(|rms| rms.mean)),
            interval: controller.rms_deg.map_or(String::new(), text::interval),
            peak: number(controller.peak_deg),
            joints: joints.unwrap_or_else(none),
            torque: number(controller.torque_rms_nm),
            beyond: controller
                .beyond_excitation
                .map_or_else(none, |share| format!("{:.1} %", 100.0 * share)),
            plan: controller.plan.map_or_else(none, |plan| {
                format!("{:.1} / {:.1}, {} threads", plan.median_ms, plan.p99_ms, plan.threads)
            }),
        }
    }
}

fn none() -> String {
    "–".to_owned()
}

//! Figures of single predictions beside the truth.

use wire::{DrawnPredictions, DrawnScenario, ScenarioRank, at_noise};

use crate::page::predict::Viewers;
use crate::page::text;

/// The figures of an evaluation, and what they have in common.
pub struct Drawn {
    pub note: String,
    pub figures: Vec<DrawnFigure>,
}

pub struct DrawnFigure {
    pub url: String,
    /// The same numbers as a table.
    pub table: String,
    pub caption: String,
    pub alt: String,
    /// The page that predicts it again, with all joints; `None` if its data are not stored.
    pub viewer: Option<String>,
}

impl Drawn {
    /// `viewers` has the pages that predict scenarios again.
    pub fn new(run: i64, drawn: &DrawnPredictions, viewers: Option<&Viewers>) -> Self {
        let model = &drawn.model;
        let figure = |scenario: &DrawnScenario| DrawnFigure {
            viewer: viewers.and_then(|viewers| {
                viewers.address(scenario.trajectory, scenario.position_noise_rad)
            }),
            ..DrawnFigure::new(run, model, scenario)
        };
        let mut scenarios: Vec<&DrawnScenario> = drawn.scenarios.iter().collect();
        // The typical one comes first.
        scenarios.sort_by_key(|scenario| scenario.rank != ScenarioRank::Median);
        Self {
            note: format!(
                "The scenarios with the median, the largest and the smallest RMSE of {model}. Each figure shows the joint \
                 with its largest error, and the legend has the RMSE of that joint."
            ),
            figures: scenarios.into_iter().map(figure).collect(),
        }
    }

    /// The median scenario alone, or the only one.
    pub fn typical(run: i64, drawn: &DrawnPredictions) -> Option<DrawnFigure> {
        let is_median = |scenario: &&DrawnScenario| scenario.rank == ScenarioRank::Median;
        let median = drawn.scenarios.iter().find(is_median);
        let scenario = median.or(drawn.scenarios.first())?;
        Some(DrawnFigure::new(run, &drawn.model, scenario))
    }
}

impl DrawnFigure {
    fn new(run: i64, model: &str, scenario: &DrawnScenario) -> Self {
        let url = |name: &str| format!("/v1/runs/{run}/artifacts/{name}");
        let rank = match scenario.rank {
            ScenarioRank::Worst => "Worst scenario",
            ScenarioRank::Median => "Median scenario",
            ScenarioRank::Best => "Best scenario",
        };
        let excitation = match (scenario.family, scenario.frequency_hz) {
            (Some(family), Some(frequency_hz)) => format!("{family} {frequency_hz} Hz, "),
            _ => String::new(),
        };
        let caption = format!(
            "{rank}{}: {excitation}trajectory {}, joint {}. RMSE of {model} over all joints: {}°",
            at_noise(scenario.position_noise_rad),
            text::count(scenario.trajectory),
            scenario.joint,
            text::degrees(scenario.rmse_deg),
        );
        let stem = scenario.figure.strip_suffix(".svg").unwrap_or(&scenario.figure);
        Self {
            url: url(&scenario.figure),
            table: url(&format!("{stem}.csv")),
            alt: format!(
                "Position of joint {} over time in degrees: the truth, and the predictions of {model}, of other models and of \
                 baselines after the end of the context.",
                scenario.joint
            ),
            caption,
            viewer: None,
        }
    }
}

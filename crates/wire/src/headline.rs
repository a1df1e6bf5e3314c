//! The key result of an evaluation.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::{Interval, PredictorInfo, PredictorKind, PredictorSummary, Report};

/// The key result of an evaluation: the best checkpoint, the best file of predictions and the best
/// baseline, in distribution. Predictors that see the future are left out.
///
/// The last task of an evaluation has it as its result, so that lists of evaluations read no
/// reports.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Headline {
    /// The group of cells that the errors are means over. Empty for an evaluation without cells.
    pub group: String,
    /// The number of scenarios of that group. Missing in older results.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scenarios: Option<u64>,
    /// The best predictor of each kind: checkpoint, file of predictions, baseline. A kind without
    /// predictors is left out.
    pub best: Vec<MeanError>,
}

/// The RMSE of a predictor, a mean over scenarios.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MeanError {
    /// The name of the predictor.
    pub predictor: String,
    /// Its RMSE over the horizon, degrees.
    pub rmse_deg: f64,
    /// Its RMSE minus that of the headline's baseline on the same scenarios, degrees. Missing for the
    /// baseline itself and in older results.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub difference_deg: Option<Interval>,
}

/// The result of an evaluation's last task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EvaluationResult {
    /// The best predictors.
    pub headline: Headline,
}

impl Headline {
    /// The headline of a report: its first group, which is the one in distribution if there is one.
    pub fn of(report: &Report) -> Self {
        let Some(group) = report.groups.first() else { return Self::default() };
        let best = |kind: PredictorKind| {
            let of_kind = |rmse: &&PredictorSummary| {
                let of_kind = |info: &&PredictorInfo| info.kind == kind && info.competes();
                report.predictors.iter().filter(of_kind).any(|info| info.name == rmse.predictor)
            };
            group
                .rmse_deg
                .iter()
                .filter(of_kind)
                .min_by(|a, b| a.interval.mean.total_cmp(&b.interval.mean))
        };
        let kinds =
            [PredictorKind::Checkpoint, PredictorKind::Predictions, PredictorKind::Baseline];
        let baseline = best(PredictorKind::Baseline).map(|rmse| rmse.predictor.as_str());
        let best = kinds.into_iter().filter_map(best).map(|rmse| MeanError {
            predictor: rmse.predictor.clone(),
            rmse_deg: rmse.interval.mean,
            difference_deg: baseline
                .and_then(|baseline| report.difference(group, &rmse.predictor, baseline)),
        });
        Self { group: group.name.clone(), scenarios: Some(group.scenarios), best: best.collect() }
    }
}

//! Summaries over cells of all measures besides the RMSE.

use rayon::prelude::*;
use spec::Bootstrap;
use wire::{Calibration, HorizonError, Interval, IntervalSummary, PredictorInfo, PredictorScores};

use crate::bootstrap::stratified_mean;
use crate::scores::{
    Aggregate, CALIBRATION, CentralInterval, INTERVALS, Measure, PerJoint, SUMMARIZED,
    ScenarioErrors,
};
use crate::{CellResult, PredictorErrors};

/// The scores of the predictors that answered everything, for each measure that exists.
pub(super) fn scores(
    predictors: &[PredictorInfo],
    cells: &[&CellResult],
    bootstrap: Bootstrap,
) -> Vec<PredictorScores> {
    predictors
        .par_iter()
        .filter_map(|info| Measured::of(&info.name, cells, bootstrap)?.scores(&info.name))
        .collect()
}

/// One predictor's errors on every scenario, a stratum per cell.
struct Measured<'a> {
    cells: Vec<&'a PredictorErrors>,
    strata: Vec<Vec<&'a ScenarioErrors>>,
    /// Lengths of the horizons over which all cells have errors, s.
    horizons_s: &'a [f64],
    bootstrap: Bootstrap,
}

impl<'a> Measured<'a> {
    fn of(predictor: &str, cells: &[&'a CellResult], bootstrap: Bootstrap) -> Option<Self> {
        let horizons_s: &[f64] = cells.first().map_or(&[], |cell| &cell.horizons_s);
        let all_have = cells.iter().all(|cell| cell.horizons_s == horizons_s);
        let cells: Vec<&PredictorErrors> =
            cells.iter().map(|cell| cell.errors(predictor)).collect::<Option<_>>()?;
        let strata: Vec<Vec<&ScenarioErrors>> = cells
            .iter()
            .map(|errors| errors.scenarios.iter().map(Option::as_ref).collect())
            .collect::<Option<_>>()?;
        (strata.iter().map(Vec::len).sum::<usize>() > 0).then_some(Self {
            cells,
            strata,
            horizons_s: if all_have { horizons_s } else { &[] },
            bootstrap,
        })
    }

    fn scores(&self, predictor: &str) -> Option<PredictorScores> {
        let joint_rmse_deg = |joint: usize| {
            let values = self.values(Measure::RmseDeg, |of_joints| f64::from(of_joints[joint]))?;
            let count = values.iter().map(Vec::len).sum::<usize>() as f64;
            Some(values.iter().flatten().sum::<f64>() / count)
        };
        let mut scores = PredictorScores {
            predictor: predictor.to_owned(),
            joint_rmse_deg: (0..self.joints()).map(joint_rmse_deg).collect::<Option<_>>()?,
            step_rmse_deg: self.step_rmse_deg(),
            horizon_errors: self.horizon_errors(),
            intervals: INTERVALS.iter().filter_map(|interval| self.central(interval)).collect(),
            calibration: self.calibration(),
            ..PredictorScores::default()
        };
        for summarized in SUMMARIZED {
            *(summarized.field)(&mut scores) = match summarized.aggregate {
                Aggregate::Mean => self.mean(summarized.measure),
                Aggregate::RootMeanSquare => self.root_mean_square(summarized.measure),
            };
        }
        Some(scores)
    }

    fn joints(&self) -> usize {
        let first = self.strata.iter().flatten().next();
        first.and_then(|errors| errors.get(Measure::RmseDeg)).map_or(0, Vec::len)
    }

    fn step_rmse_deg(&self) -> Vec<f64> {
        let steps = self.cells.iter().map(|cell| cell.step_squares_deg2.len()).min().unwrap_or(0);
        let entries = (self.strata.iter().map(Vec::len).sum::<usize>() * self.joints()) as f64;
        let squares = |step: usize| {
            self.cells.iter().flat_map(move |cell| &cell.step_squares_deg2[step]).sum::<f64>()
        };
        (0..steps).map(|step| (squares(step) / entries).sqrt()).collect()
    }

    fn horizon_errors(&self) -> Vec<HorizonError> {
        let over = |(k, &seconds): (usize, &f64)| {
            let of_scenario = |errors: &&ScenarioErrors| errors.horizons.get(k).map(mean_of);
            let strata = self.strata.iter();
            let values: Vec<Vec<f64>> = strata
                .map(|stratum| stratum.iter().map(of_scenario).collect())
                .collect::<Option<_>>()?;
            Some(HorizonError { seconds, rmse_deg: stratified_mean(&values, self.bootstrap) })
        };
        self.horizons_s.iter().enumerate().filter_map(over).collect()
    }

    fn central(&self, interval: &CentralInterval) -> Option<IntervalSummary> {
        Some(IntervalSummary {
            nominal: interval.nominal,
            coverage: self.mean(interval.coverage)?,
            width_deg: self.mean(interval.width_deg)?,
        })
    }

    fn calibration(&self) -> Vec<Calibration> {
        let of = |level: usize| {
            let of_cells = self.cells.iter().zip(&self.strata);
            let weighted = of_cells.map(|(cell, stratum)| {
                let count = stratum.len() as f64;
                Some((count * cell.calibration.get(level)?, count))
            });
            let (sum, count) = weighted
                .collect::<Option<Vec<_>>>()?
                .into_iter()
                .fold((0.0, 0.0), |total, one| (total.0 + one.0, total.1 + one.1));
            Some(sum / count)
        };
        CALIBRATION
            .into_iter()
            .enumerate()
            .filter_map(|(level, nominal)| Some(Calibration { nominal, coverage: of(level)? }))
            .collect()
    }

    /// A value of each scenario. `None` unless all were measured.
    fn values(&self, measure: Measure, of: impl Fn(&PerJoint) -> f64) -> Option<Vec<Vec<f64>>> {
        let of_scenario = |errors: &&ScenarioErrors| errors.get(measure).map(&of);
        self.strata.iter().map(|stratum| stratum.iter().map(of_scenario).collect()).collect()
    }

    fn mean(&self, measure: Measure) -> Option<Interval> {
        Some(stratified_mean(&self.values(measure, mean_of)?, self.bootstrap))
    }

    /// Over scenarios and joints. The root is monotonic, so its interval is the root of that of the
    /// mean square.
    fn root_mean_square(&self, measure: Measure) -> Option<Interval> {
        let square = |of_joints: &PerJoint| {
            let squares = of_joints.iter().map(|value| f64::from(*value).powi(2));
            squares.sum::<f64>() / of_joints.len() as f64
        };
        let Interval { mean, low, high } =
            stratified_mean(&self.values(measure, square)?, self.bootstrap);
        Some(Interval { mean: mean.sqrt(), low: low.sqrt(), high: high.sqrt() })
    }
}

fn mean_of(joints: &PerJoint) -> f64 {
    joints.iter().map(|value| f64::from(*value)).sum::<f64>() / joints.len() as f64
}

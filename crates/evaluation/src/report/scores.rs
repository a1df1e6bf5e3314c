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
        let mut scores = PredictorScores {
            predictor: predictor.to_owned(),
            joint_rmse_deg: self.by_joint(Measure::RmseDeg)?,
            step_rmse_deg: self.step_rmse_deg(),
            horizon_errors: self.horizon_errors(),
            intervals: (0..).zip(&INTERVALS).filter_map(|(k, it)| self.central(k, it)).collect(),
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
            let of_scenario = |errors: &&ScenarioErrors| errors.horizon(k);
            let strata = self.strata.iter();
            let values: Vec<Vec<f64>> = strata
                .map(|stratum| stratum.iter().map(of_scenario).collect())
                .collect::<Option<_>>()?;
            Some(HorizonError { seconds, rmse_deg: stratified_mean(&values, self.bootstrap) })
        };
        self.horizons_s.iter().enumerate().filter_map(over).collect()
    }

    /// The summary of the `k`th interval.
    fn central(&self, k: usize, interval: &CentralInterval) -> Option<IntervalSummary> {
        let of_steps = |cell: &PredictorErrors| cell.step_coverage.get(k).cloned();
        Some(IntervalSummary {
            nominal: interval.nominal,
            coverage: self.mean(interval.coverage)?,
            width_deg: self.mean(interval.width_deg)?,
            joint_coverage: self.by_joint(interval.coverage)?,
            step_coverage: self.weighted(of_steps).unwrap_or_default(),
        })
    }

    /// The mean of a measure over scenarios, for each joint.
    fn by_joint(&self, measure: Measure) -> Option<Vec<f64>> {
        let mean = |joint: usize| {
            let values = self.values(measure, |of_joints| f64::from(of_joints[joint]))?;
            let count = values.iter().map(Vec::len).sum::<usize>() as f64;
            Some(values.iter().flatten().sum::<f64>() / count)
        };
        (0..self.joints()).map(mean).collect()
    }

    /// The mean over scenarios of numbers that each cell has as means. `None` unless all cells have
    /// equally many.
    fn weighted(&self, of: impl Fn(&PredictorErrors) -> Option<Vec<f64>>) -> Option<Vec<f64>> {
        let of_cells: Vec<Vec<f64>> =
            self.cells.iter().map(|cell| of(cell)).collect::<Option<_>>()?;
        let all: f64 = self.strata.iter().map(|stratum| stratum.len() as f64).sum();
        let mut sums = vec![0.0; of_cells.first()?.len()];
        for (numbers, stratum) in of_cells.iter().zip(&self.strata) {
            if numbers.len() != sums.len() {
                return None;
            }
            for (sum, number) in sums.iter_mut().zip(numbers) {
                *sum += number * stratum.len() as f64 / all;
            }
        }
        Some(sums)
    }

    fn calibration(&self) -> Vec<Calibration> {
        let coverage = self.weighted(|cell| Some(cell.calibration.clone())).unwrap_or_default();
        let levels = CALIBRATION.into_iter().zip(coverage);
        levels.map(|(nominal, coverage)| Calibration { nominal, coverage }).collect()
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

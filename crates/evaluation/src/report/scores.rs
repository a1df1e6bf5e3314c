//! Summaries over cells of all measures besides the RMSE.

use rayon::prelude::*;
use spec::Bootstrap;
use wire::{Calibration, Interval, IntervalSummary, PredictorInfo, PredictorScores};

use super::summary::errors;
use crate::scores::{ContinuityErrors, PerJoint, SampleErrors, ScenarioErrors};
use crate::{CALIBRATION, CellResult, INTERVALS, PredictorErrors, stratified_mean};

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
    bootstrap: Bootstrap,
}

impl<'a> Measured<'a> {
    fn of(predictor: &str, cells: &[&'a CellResult], bootstrap: Bootstrap) -> Option<Self> {
        let cells: Vec<&PredictorErrors> =
            cells.iter().map(|cell| errors(cell, predictor)).collect::<Option<_>>()?;
        let strata: Vec<Vec<&ScenarioErrors>> = cells
            .iter()
            .map(|errors| errors.scenarios.iter().map(Option::as_ref).collect())
            .collect::<Option<_>>()?;
        (strata.iter().map(Vec::len).sum::<usize>() > 0).then_some(Self {
            cells,
            strata,
            bootstrap,
        })
    }

    fn scores(&self, predictor: &str) -> Option<PredictorScores> {
        let of_joint = |joint: usize| self.mean(|errors| Some(f64::from(errors.rmse_deg[joint])));
        let joint_rmse_deg: Vec<f64> = (0..self.joints()).map(of_joint).collect::<Option<_>>()?;
        let jitter = |of: fn(&crate::Jitter) -> &PerJoint| {
            self.interval(|errors| errors.jitter.as_ref().map(|jitter| mean(of(jitter))))
        };
        let samples =
            |of: fn(&SampleErrors) -> f64| self.interval(|errors| errors.samples.as_ref().map(of));
        Some(PredictorScores {
            predictor: predictor.to_owned(),
            joint_rmse_deg,
            step_rmse_deg: self.step_rmse_deg(),
            first_sample_deg: self
                .root_mean_square(|continuity| Some(&continuity.first_sample_deg)),
            jump_deg: self.root_mean_square(|continuity| Some(&continuity.jump_deg)),
            seam_jump_deg: self.root_mean_square(|continuity| continuity.seam_jump_deg.as_ref()),
            largest_jump_deg: self
                .interval(|errors| Some(mean(&errors.continuity.as_ref()?.largest_jump_deg))),
            jitter_deg: jitter(|jitter| &jitter.deg),
            smoothed_jitter_deg: jitter(|jitter| &jitter.smoothed_deg),
            smoothed_rmse_deg: jitter(|jitter| &jitter.smoothed_rmse_deg),
            mean_rmse_deg: samples(|errors| mean(&errors.mean_rmse_deg)),
            crps_deg: samples(|errors| mean(&errors.crps_deg)),
            energy_score_deg: samples(|errors| f64::from(errors.energy_score_deg)),
            intervals: INTERVALS.iter().filter_map(|&nominal| self.central(nominal)).collect(),
            calibration: self.calibration(),
        })
    }

    fn joints(&self) -> usize {
        self.strata.iter().flatten().next().map_or(0, |errors| errors.rmse_deg.len())
    }

    fn step_rmse_deg(&self) -> Vec<f64> {
        let steps = self.cells.iter().map(|cell| cell.step_squares_deg2.len()).min().unwrap_or(0);
        let entries = (self.strata.iter().map(Vec::len).sum::<usize>() * self.joints()) as f64;
        let squares = |step: usize| {
            self.cells.iter().flat_map(move |cell| &cell.step_squares_deg2[step]).sum::<f64>()
        };
        (0..steps).map(|step| (squares(step) / entries).sqrt()).collect()
    }

    fn central(&self, nominal: f64) -> Option<IntervalSummary> {
        let of = |pick: fn(&crate::IntervalErrors) -> &PerJoint| {
            self.interval(|errors| {
                let samples = errors.samples.as_ref()?;
                let found =
                    samples.intervals.iter().find(|interval| interval.nominal == nominal)?;
                Some(mean(pick(found)))
            })
        };
        let coverage = of(|interval| &interval.coverage)?;
        let width_deg = of(|interval| &interval.width_deg)?;
        Some(IntervalSummary { nominal, coverage, width_deg })
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

    /// A value of each scenario. `None` unless all have one.
    fn values(&self, of: impl Fn(&ScenarioErrors) -> Option<f64>) -> Option<Vec<Vec<f64>>> {
        let of = &of;
        self.strata
            .iter()
            .map(|stratum| stratum.iter().map(|errors| of(errors)).collect())
            .collect()
    }

    fn interval(&self, of: impl Fn(&ScenarioErrors) -> Option<f64>) -> Option<Interval> {
        Some(stratified_mean(&self.values(of)?, self.bootstrap))
    }

    /// Over scenarios and joints. The root is monotonic, so its interval is the root of that of the
    /// mean square.
    fn root_mean_square(
        &self,
        of: impl Fn(&ContinuityErrors) -> Option<&PerJoint>,
    ) -> Option<Interval> {
        let square = |errors: &ScenarioErrors| {
            let values = of(errors.continuity.as_ref()?)?;
            let squares = values.iter().map(|value| f64::from(*value).powi(2));
            Some(squares.sum::<f64>() / values.len() as f64)
        };
        let Interval { mean, low, high } = self.interval(square)?;
        Some(Interval { mean: mean.sqrt(), low: low.sqrt(), high: high.sqrt() })
    }

    fn mean(&self, of: impl Fn(&ScenarioErrors) -> Option<f64>) -> Option<f64> {
        let values = self.values(of)?;
        let count = values.iter().map(Vec::len).sum::<usize>() as f64;
        Some(values.iter().flatten().sum::<f64>() / count)
    }
}

fn mean(values: &[f32]) -> f64 {
    values.iter().map(|value| f64::from(*value)).sum::<f64>() / values.len() as f64
}

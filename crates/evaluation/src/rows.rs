//! The result table: one row per scenario, joint and predictor.

use crate::scores::{
    ContinuityErrors, IntervalErrors, Jitter, PerJoint, SampleErrors, ScenarioErrors,
};
use crate::{CellResult, INTERVALS, PredictorErrors};

/// One scenario, joint and predictor. Errors are `None` where there is no answer. So are values
/// that were not measured or that need more samples.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Row<'a> {
    /// Index of the trajectory in the dataset.
    pub trajectory: u64,
    /// Number of the joint, from 1.
    pub joint: usize,
    pub predictor: &'a str,
    pub rmse_deg: Option<f32>,
    pub first_sample_deg: Option<f32>,
    pub jump_deg: Option<f32>,
    pub seam_jump_deg: Option<f32>,
    pub largest_jump_deg: Option<f32>,
    pub beyond_limits_deg: Option<f32>,
    pub jitter_deg: Option<f32>,
    pub smoothed_jitter_deg: Option<f32>,
    pub smoothed_rmse_deg: Option<f32>,
    pub mean_rmse_deg: Option<f32>,
    pub crps_deg: Option<f32>,
    pub energy_score_deg: Option<f32>,
    pub coverage_50: Option<f32>,
    pub width_50_deg: Option<f32>,
    pub coverage_90: Option<f32>,
    pub width_90_deg: Option<f32>,
}

/// A column of the table with a measured value.
#[derive(Clone, Copy, Debug)]
pub struct Measure {
    pub name: &'static str,
    pub about: &'static str,
    pub get: fn(&Row<'_>) -> Option<f32>,
    pub set: fn(&mut Row<'_>, Option<f32>),
}

macro_rules! measures {
    ($($name:ident: $about:literal,)+) => {
        /// The columns with measured values, in order. They follow the columns that identify a row.
        pub const MEASURES: &[Measure] = &[$(Measure {
            name: stringify!($name),
            about: $about,
            get: |row| row.$name,
            set: |row, value| row.$name = value,
        }),+];
    };
}

measures! {
    rmse_deg: "root mean square error over the horizon",
    first_sample_deg: "size of the error of the first sample of the horizon",
    jump_deg: "root mean square of the change of the error from one sample to the next, seams left out",
    seam_jump_deg: "the same over the seams between the patches that a model predicts one by one",
    largest_jump_deg: "the largest change of the error from one sample to the next",
    beyond_limits_deg: "how far the prediction lies beyond the limits of the joint at most; 0 within",
    jitter_deg: "root mean square of the prediction above the band of the excitation",
    smoothed_jitter_deg: "the same after a zero-phase low-pass at the edge of the band",
    smoothed_rmse_deg: "root mean square error after that low-pass",
    mean_rmse_deg: "root mean square error of the mean of the samples",
    crps_deg: "fair continuous ranked probability score, mean over the horizon",
    energy_score_deg: "fair energy score of the scenario, the same for all its joints",
    coverage_50: "share of the horizon inside the central 50 % interval",
    width_50_deg: "mean width of that interval",
    coverage_90: "share of the horizon inside the central 90 % interval",
    width_90_deg: "mean width of that interval",
}

impl CellResult {
    /// The rows of all scenarios, joints and predictors, in the order predictor, scenario, joint. A
    /// predictor whose result has only means has no rows.
    pub fn rows(&self) -> impl Iterator<Item = Row<'_>> {
        self.predictors.iter().flat_map(move |errors| {
            errors.scenarios.iter().enumerate().flat_map(move |(scenario, scores)| {
                (0..self.joints)
                    .map(move |joint| self.row(errors, scenario, scores.as_ref(), joint))
            })
        })
    }

    /// Completes a result without [`PredictorErrors::scenarios`] from its rows, in the order of
    /// [`CellResult::rows`]. Gives false if they are not the rows of this result.
    pub fn take_rows(&mut self, rows: &[Row<'_>]) -> bool {
        let mut rows = rows.chunks(self.joints.max(1));
        for errors in &mut self.predictors {
            let count = errors.rmse_deg.len();
            let own: Vec<&[Row<'_>]> = rows.by_ref().take(count).collect();
            let name = errors.predictor.as_str();
            let is_whole = |rows: &&[Row<'_>]| {
                rows.len() == self.joints && rows.iter().all(|row| row.predictor == name)
            };
            if own.len() != count || !own.iter().all(is_whole) {
                return false;
            }
            errors.scenarios = own.into_iter().map(ScenarioErrors::of_rows).collect();
        }
        rows.next().is_none()
    }

    fn row<'a>(
        &self,
        errors: &'a PredictorErrors,
        scenario: usize,
        scores: Option<&ScenarioErrors>,
        joint: usize,
    ) -> Row<'a> {
        let continuity = scores.and_then(|scores| scores.continuity.as_ref());
        let jitter = scores.and_then(|scores| scores.jitter.as_ref());
        let samples = scores.and_then(|scores| scores.samples.as_ref());
        let interval = |nominal: f64| {
            samples.and_then(|samples| {
                samples.intervals.iter().find(|interval| interval.nominal == nominal)
            })
        };
        let of_joint = |values: &PerJoint| values[joint];
        Row {
            trajectory: self.first + scenario as u64,
            joint: joint + 1,
            predictor: &errors.predictor,
            rmse_deg: scores.map(|scores| of_joint(&scores.rmse_deg)),
            first_sample_deg: continuity.map(|continuity| of_joint(&continuity.first_sample_deg)),
            jump_deg: continuity.map(|continuity| of_joint(&continuity.jump_deg)),
            seam_jump_deg: continuity
                .and_then(|continuity| continuity.seam_jump_deg.as_ref().map(of_joint)),
            largest_jump_deg: continuity.map(|continuity| of_joint(&continuity.largest_jump_deg)),
            beyond_limits_deg: scores
                .and_then(|scores| scores.beyond_limits_deg.as_ref().map(of_joint)),
            jitter_deg: jitter.map(|jitter| of_joint(&jitter.deg)),
            smoothed_jitter_deg: jitter.map(|jitter| of_joint(&jitter.smoothed_deg)),
            smoothed_rmse_deg: jitter.map(|jitter| of_joint(&jitter.smoothed_rmse_deg)),
            mean_rmse_deg: samples.map(|samples| of_joint(&samples.mean_rmse_deg)),
            crps_deg: samples.map(|samples| of_joint(&samples.crps_deg)),
            energy_score_deg: samples.map(|samples| samples.energy_score_deg),
            coverage_50: interval(0.5).map(|interval| of_joint(&interval.coverage)),
            width_50_deg: interval(0.5).map(|interval| of_joint(&interval.width_deg)),
            coverage_90: interval(0.9).map(|interval| of_joint(&interval.coverage)),
            width_90_deg: interval(0.9).map(|interval| of_joint(&interval.width_deg)),
        }
    }
}

impl ScenarioErrors {
    /// The errors of a scenario from its rows. They lack the calibration, which rows do not have.
    fn of_rows(rows: &[Row<'_>]) -> Option<Self> {
        let jitter = || {
            Some(Jitter {
                deg: of_joints(rows, |row| row.jitter_deg)?,
                smoothed_deg: of_joints(rows, |row| row.smoothed_jitter_deg)?,
                smoothed_rmse_deg: of_joints(rows, |row| row.smoothed_rmse_deg)?,
            })
        };
        let continuity = || {
            Some(ContinuityErrors {
                first_sample_deg: of_joints(rows, |row| row.first_sample_deg)?,
                jump_deg: of_joints(rows, |row| row.jump_deg)?,
                largest_jump_deg: of_joints(rows, |row| row.largest_jump_deg)?,
                seam_jump_deg: of_joints(rows, |row| row.seam_jump_deg),
            })
        };
        Some(Self {
            rmse_deg: of_joints(rows, |row| row.rmse_deg)?,
            continuity: continuity(),
            beyond_limits_deg: of_joints(rows, |row| row.beyond_limits_deg),
            jitter: jitter(),
            samples: SampleErrors::of_rows(rows),
        })
    }
}

impl SampleErrors {
    fn of_rows(rows: &[Row<'_>]) -> Option<Self> {
        let intervals = INTERVALS.into_iter().zip([
            (of_joints(rows, |row| row.coverage_50), of_joints(rows, |row| row.width_50_deg)),
            (of_joints(rows, |row| row.coverage_90), of_joints(rows, |row| row.width_90_deg)),
        ]);
        let intervals = intervals.filter_map(|(nominal, (coverage, width_deg))| {
            Some(IntervalErrors { nominal, coverage: coverage?, width_deg: width_deg? })
        });
        Some(Self {
            mean_rmse_deg: of_joints(rows, |row| row.mean_rmse_deg)?,
            crps_deg: of_joints(rows, |row| row.crps_deg)?,
            energy_score_deg: rows.first()?.energy_score_deg?,
            intervals: intervals.collect(),
            calibration: Vec::new(),
        })
    }
}

fn of_joints(rows: &[Row<'_>], value: impl Fn(&Row<'_>) -> Option<f32>) -> Option<PerJoint> {
    rows.iter().map(value).collect()
}

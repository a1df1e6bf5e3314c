//! The result table: one row per scenario, joint and predictor.

use crate::scores::{Measure, ScenarioErrors};
use crate::{CellResult, PredictorErrors};

/// One scenario, joint and predictor.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Row<'a> {
    /// Index of the trajectory in the dataset.
    pub trajectory: u64,
    /// Number of the joint, from 1.
    pub joint: usize,
    /// The predictor's name.
    pub predictor: &'a str,
    values: [Option<f32>; Measure::ALL.len()],
    /// RMSE over each of [`CellResult::horizons_s`], degrees.
    horizons: Vec<Option<f32>>,
}

impl<'a> Row<'a> {
    /// A row without values, of a cell with this number of [`CellResult::horizons_s`]. The
    /// trajectory is 0.
    pub fn empty(predictor: &'a str, joint: usize, horizons: usize) -> Self {
        Self { predictor, joint, horizons: vec![None; horizons], ..Self::default() }
    }

    /// The RMSE over the `k`th of [`CellResult::horizons_s`], degrees. `None` where there is no
    /// answer, and where it was not measured.
    pub fn horizon(&self, k: usize) -> Option<f32> {
        self.horizons.get(k).copied().flatten()
    }

    /// Replaces the RMSE over the `k`th of [`CellResult::horizons_s`].
    ///
    /// # Panics
    /// If the cell has fewer of them.
    pub fn set_horizon(&mut self, k: usize, value: Option<f32>) {
        self.horizons[k] = value;
    }

    /// The value of a measure, as the score of the row's scenario and joint. `None` where there is
    /// no answer, for values that were not measured, and for those that need more samples.
    pub const fn get(&self, measure: Measure) -> Option<f32> {
        self.values[measure as usize]
    }

    /// Replaces the value of a measure.
    pub const fn set(&mut self, measure: Measure, value: Option<f32>) {
        self.values[measure as usize] = value;
    }
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
        let horizons = self.horizons_s.len();
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
            let scenario = |rows: &[Row<'_>]| {
                let over = |k| rows.iter().map(|row| row.horizon(k)).collect();
                ScenarioErrors::of_joints(
                    |measure| rows.iter().map(|row| row.get(measure)).collect(),
                    (0..horizons).map(over).collect::<Option<_>>().unwrap_or_default(),
                )
            };
            errors.scenarios = own.into_iter().map(scenario).collect();
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
        Row {
            trajectory: self.first + scenario as u64,
            joint: joint + 1,
            predictor: &errors.predictor,
            values: Measure::ALL.map(|measure| Some(scores?.get(measure)?[joint])),
            horizons: (0..self.horizons_s.len())
                .map(|k| Some(scores?.horizons.get(k)?[joint]))
                .collect(),
        }
    }
}

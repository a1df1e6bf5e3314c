//! One cell of an evaluation: every predictor is asked the same question about the same scenarios.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use series::{JointMotion, Observed, SeriesView, mean_torques};
use spec::{Family, Given, Range};
use wire::Warning;

use crate::metrics::{JitterMeter, beyond_limits_deg, has_diverged, squares_deg2, torque_rmse_nm};
use crate::predictor::Answer;
use crate::scores::{Measure, ScenarioErrors, ScoredAs, degrees};
use crate::{ErrorHorizon, EvaluationError, Predictor};

/// The errors of every predictor on the same scenarios of one cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CellResult {
    /// Index of the cell in the evaluation, from 0.
    pub cell: usize,
    /// The excitation family; `None` for data without a frequency grid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub family: Option<Family>,
    /// The excitation's frequency; `None` for data without a frequency grid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frequency_hz: Option<f64>,
    /// Standard deviation of the noise that was added to the positions of contexts, rad.
    #[serde(default)]
    pub position_noise_rad: f64,
    /// Index of the first scenario in the dataset; the others follow.
    pub first: u64,
    /// Joints of every robot.
    pub joints: usize,
    /// Lengths of the first parts of the horizon whose errors its rows have, s. Empty in results of
    /// versions that did not measure them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub horizons_s: Vec<f64>,
    /// The errors, in the order of the asked predictors.
    pub predictors: Vec<PredictorErrors>,
    /// The jitter of the measured motions, see [`measured_jitter_deg`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured_jitter_deg: Option<f64>,
    /// Share of the scenarios in which the measured motion leaves the joints' limits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured_left_limits: Option<f64>,
    /// Whether the torques of each scenario, context and horizon, stay within the rated torques of
    /// every joint. Empty where these are not known.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub within_torque_limits: Vec<bool>,
    /// Warnings about data unlike that of the checkpoints' trainings, and about contexts that
    /// identify nothing.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<Warning>,
}

/// One predictor's errors on the scenarios of a cell, in order.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PredictorErrors {
    /// Its name, which the report's tables show.
    pub predictor: String,
    /// RMSE of each scenario over horizon and joints; `None` without an answer.
    pub rmse_deg: Vec<Option<f64>>,
    /// All measures of each scenario; `None` without an answer. The table of [`Row`]s stores them,
    /// the JSON of a result does not.
    #[serde(skip)]
    pub scenarios: Vec<Option<ScenarioErrors>>,
    /// Squared error of each step of the horizon and each joint, summed over the scenarios with an
    /// answer.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub step_squares_deg2: Vec<Vec<f64>>,
    /// Mean of [`ScenarioErrors::calibration`] over the scenarios with an answer.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub calibration: Vec<f64>,
    /// Mean of [`ScenarioErrors::step_coverage`] over the scenarios with an answer.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub step_coverage: Vec<Vec<f64>>,
    /// The scenarios without an answer; `None` if it answered all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failure: Option<Failure>,
    /// `None` where the predictor failed on the cell as a whole.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rollouts: Option<Rollouts>,
    /// The scenarios in which the robot moves and the prediction does not, counted from 0 in the
    /// cell.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub held: Vec<usize>,
    /// The scenarios that diverged by [`has_diverged`], counted from 0 in the cell.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub diverged: Vec<usize>,
}

impl CellResult {
    /// The errors of a predictor. `None` if it was not asked.
    pub fn errors(&self, predictor: &str) -> Option<&PredictorErrors> {
        self.predictors.iter().find(|errors| errors.predictor == predictor)
    }

    /// Number of its scenarios.
    pub fn scenarios(&self) -> usize {
        self.predictors.first().map_or(0, |errors| errors.rmse_deg.len())
    }

    /// The share of scenarios within the torque limits. `None` where the limits are not known.
    pub(crate) fn share_within_torque_limits(&self) -> Option<f64> {
        let within = self.within_torque_limits.iter().filter(|within| **within).count();
        let all = self.within_torque_limits.len();
        (all > 0).then(|| within as f64 / all as f64)
    }
}

/// Where the predictions of a cell lead. Predictions that are not finite count, too.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Rollouts {
    /// Number of scenarios in which some joint leaves its limits. `None` where limits are not
    /// known.
    pub left_limits: Option<usize>,
    /// Number of scenarios that diverged by [`has_diverged`].
    pub diverged: usize,
}

/// Scenarios of a cell without an answer of a predictor.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Failure {
    /// Number of such scenarios.
    pub scenarios: usize,
    /// The first of them, counted from 0 in the cell.
    pub first: usize,
    /// Why the first of them has no answer.
    pub reason: String,
}

/// The settings of questions and scores.
#[derive(Clone, Debug, PartialEq)]
pub struct Scoring {
    /// Samples of the recording before the window. Only predictors that continue their own earlier
    /// predictions use them.
    pub pre_roll: usize,
    /// Number of samples with positions that a predictor observes.
    pub context: usize,
    /// Samples that are drawn from every generative predictor. Below 2 none are drawn.
    pub samples: usize,
    /// The frequency above which a prediction's power is jitter, see
    /// [`crate::metrics::band_edge_hz`]. With `None` jitter is not measured.
    pub band_edge_hz: Option<f64>,
    /// The series that predictors are given. Only with torques they are asked for the torques of the
    /// measured motion, too.
    pub given: Given,
    /// Limits of each joint's position; empty where they are not known.
    pub limits_rad: Vec<Range>,
    /// First parts of the horizon whose errors are measured as well.
    pub horizons: Vec<ErrorHorizon>,
}

/// Asks each predictor the same question and scores the answers.
///
/// If a predictor fails, or has no finite answer to some scenarios, its
/// [`PredictorErrors::failure`] says so. The other predictors are scored all the same.
///
/// # Panics
/// Like [`SeriesView::observed`].
pub fn evaluate_cell(
    scenarios: &SeriesView<'_>,
    scoring: &Scoring,
    predictors: &[Box<dyn Predictor + '_>],
) -> Vec<PredictorErrors> {
    let observed = scenarios.observed(scoring.pre_roll, scoring.context);
    let (truth, joints) = (scoring.truth(scenarios), observed.joints());
    let row = observed.horizon() * joints;
    let motions = match scoring.given {
        Given::Torques => truth
            .chunks_exact(row)
            .map(|positions| JointMotion::measured(positions, joints, observed.rate_hz()))
            .collect(),
        Given::References => Vec::new(),
    };
    let scorer = Scorer {
        truth: &truth,
        motions: &motions,
        row,
        joints,
        limits_rad: &scoring.limits_rad,
        horizons: &scoring.horizons,
        meter: meter(&observed, scoring),
    };
    predictors.iter().map(|predictor| scorer.errors(&**predictor, &observed, scoring)).collect()
}

/// Root mean square above the band's edge in the measured horizon, as a mean over joints and
/// scenarios. The jitter of a predictor below this value has its origin in the measurement.
///
/// # Panics
/// Like [`SeriesView::observed`].
pub fn measured_jitter_deg(scenarios: &SeriesView<'_>, scoring: &Scoring) -> Option<f64> {
    let observed = scenarios.observed(scoring.pre_roll, scoring.context);
    let meter = meter(&observed, scoring)?;
    let truth = scoring.truth(scenarios);
    let joints = observed.joints();
    let rows = truth.chunks_exact(observed.horizon() * joints);
    let total: f64 = rows
        .flat_map(|row| (0..joints).map(move |joint| degrees(row, joint, joints)))
        .map(|series| meter.jitter(&series))
        .sum();
    (scenarios.robots() > 0).then(|| total / (scenarios.robots() * joints) as f64)
}

/// The share of scenarios whose measured horizon leaves the joints' limits, whatever a predictor
/// answers.
///
/// # Panics
/// Like [`SeriesView::observed`].
pub fn measured_left_limits(scenarios: &SeriesView<'_>, scoring: &Scoring) -> Option<f64> {
    if scoring.limits_rad.is_empty() || scenarios.robots() == 0 {
        return None;
    }
    let truth = scoring.truth(scenarios);
    let rows = truth.chunks_exact(truth.len() / scenarios.robots());
    let left = rows.filter(|row| has_left(row, &scoring.limits_rad)).count();
    Some(left as f64 / scenarios.robots() as f64)
}

/// Whether the torques of each scenario stay within `limits_nm`, one per joint. Empty without
/// limits.
pub fn within_torque_limits(scenarios: &SeriesView<'_>, limits_nm: &[f64]) -> Vec<bool> {
    if limits_nm.is_empty() {
        return Vec::new();
    }
    let is_within = |robot: usize| {
        limits_nm.iter().enumerate().all(|(joint, limit)| {
            scenarios.u(robot).joint(joint).all(|torque| f64::from(torque).abs() <= *limit)
        })
    };
    (0..scenarios.robots()).map(is_within).collect()
}

fn has_left(positions: &[f32], limits_rad: &[Range]) -> bool {
    beyond_limits_deg(positions, limits_rad).iter().any(|&beyond| beyond > 0.0)
}

fn meter(observed: &Observed<'_>, scoring: &Scoring) -> Option<JitterMeter> {
    JitterMeter::new(observed.horizon(), scoring.band_edge_hz?, observed.rate_hz())
}

impl Scoring {
    /// True positions of the horizon, `[robot, horizon, joint]`, rad.
    fn truth(&self, scenarios: &SeriesView<'_>) -> Vec<f32> {
        scenarios.window(self.pre_roll + self.context..scenarios.samples()).copy_true_y()
    }
}

struct Scorer<'a> {
    /// `[robot, horizon, joint]`.
    truth: &'a [f32],
    /// The motion of each robot over the horizon. Empty if torques are not asked for.
    motions: &'a [JointMotion],
    /// Values per scenario.
    row: usize,
    joints: usize,
    limits_rad: &'a [Range],
    horizons: &'a [ErrorHorizon],
    meter: Option<JitterMeter>,
}

impl Scorer<'_> {
    fn errors(
        &self,
        predictor: &dyn Predictor,
        observed: &Observed<'_>,
        scoring: &Scoring,
    ) -> PredictorErrors {
        let size = observed.robots();
        let (answer, torques) = match self.ask(predictor, observed, scoring) {
            Ok(answers) => answers,
            Err(error) => {
                let reason = spec::causes(&error);
                return PredictorErrors {
                    predictor: predictor.name().to_owned(),
                    rmse_deg: vec![None; size],
                    scenarios: vec![None; size],
                    failure: Some(Failure { scenarios: size, first: 0, reason }),
                    ..PredictorErrors::default()
                };
            }
        };
        let patch = predictor.patch();
        let scenarios: Vec<Option<ScenarioErrors>> = (0..size)
            .into_par_iter()
            .map(|k| {
                let mut errors = self.score(&answer, patch, k)?;
                let said = torques.as_ref().and_then(|torques| torques.get(k));
                if let Some(rmse_nm) = said.and_then(|said| self.torque_rmse_nm(said, observed, k))
                {
                    errors.set(Measure::TorqueRmseNm, rmse_nm);
                }
                Some(errors)
            })
            .collect();
        let mut squares = vec![0.0; self.row];
        for scenario in (0..size).filter(|&scenario| scenarios[scenario].is_some()) {
            let of_scenario = scenario * self.row..(scenario + 1) * self.row;
            let (truth, predicted) =
                (&self.truth[of_scenario.clone()], &answer.positions[of_scenario]);
            for (sum, square) in squares.iter_mut().zip(squares_deg2(truth, predicted)) {
                *sum += square;
            }
        }
        let failed = scenarios.iter().filter(|errors| errors.is_none()).count();
        let first = scenarios.iter().position(Option::is_none);
        PredictorErrors {
            predictor: predictor.name().to_owned(),
            rmse_deg: scenarios
                .iter()
                .map(|errors| errors.as_ref()?.mean(Measure::RmseDeg))
                .collect(),
            failure: first.map(|first| Failure {
                scenarios: failed,
                first,
                reason: "a value that is not finite".to_owned(),
            }),
            calibration: mean_over_scenarios(&scenarios, |errors| &errors.calibration),
            step_coverage: step_coverage(&scenarios),
            scenarios,
            rollouts: Some(self.rollouts(&answer)),
            held: self.held(&answer).collect(),
            diverged: self.diverged(&answer).collect(),
            step_squares_deg2: squares.chunks(self.joints).map(<[f64]>::to_vec).collect(),
        }
    }

    /// The positions that a predictor answers with, and the torques that it says for the measured
    /// motions.
    #[expect(clippy::type_complexity, reason = "two answers, the second as the trait gives it")]
    fn ask(
        &self,
        predictor: &dyn Predictor,
        observed: &Observed<'_>,
        scoring: &Scoring,
    ) -> Result<(Answer, Option<Vec<Vec<f64>>>), EvaluationError> {
        let check = |got: usize, expected: usize| {
            let predictor = predictor.name().to_owned();
            if got == expected {
                return Ok(());
            }
            Err(EvaluationError::WrongLength { predictor, got, expected })
        };
        let answer = predictor.answer(observed, scoring.samples)?;
        check(answer.positions.len(), self.truth.len())?;
        if let Some(samples) = &answer.samples {
            check(samples.positions.len(), samples.count * self.truth.len())?;
        }
        let torques = match self.motions {
            [] => None,
            motions => predictor.torques(observed, &answer, motions)?,
        };
        Ok((answer, torques))
    }

    fn torque_rmse_nm(
        &self,
        said: &[f64],
        observed: &Observed<'_>,
        scenario: usize,
    ) -> Option<Vec<f64>> {
        let torques = &observed.u(scenario).values()[observed.context() * self.joints..];
        let acted = mean_torques(torques, self.joints, observed.rate_hz());
        torque_rmse_nm(said, &acted, self.joints)
    }

    fn rollouts(&self, answer: &Answer) -> Rollouts {
        let each = || self.truth.chunks(self.row).zip(answer.positions.chunks(self.row));
        let left = || each().filter(|(_, predicted)| has_left(predicted, self.limits_rad)).count();
        Rollouts {
            left_limits: (!self.limits_rad.is_empty()).then(left),
            diverged: self.diverged(answer).count(),
        }
    }

    fn diverged<'b>(&'b self, answer: &'b Answer) -> impl Iterator<Item = usize> + 'b {
        let each = self.truth.chunks(self.row).zip(answer.positions.chunks(self.row));
        let diverged =
            each.enumerate().filter(|(_, (truth, predicted))| has_diverged(truth, predicted));
        diverged.map(|(scenario, _)| scenario)
    }

    fn held<'b>(&'b self, answer: &'b Answer) -> impl Iterator<Item = usize> + 'b {
        let stands = |row: &[f32]| row.chunks(self.joints).all(|now| now == &row[..self.joints]);
        let each = self.truth.chunks(self.row).zip(answer.positions.chunks(self.row));
        let held = each
            .enumerate()
            .filter(move |(_, (truth, predicted))| stands(predicted) && !stands(truth));
        held.map(|(scenario, _)| scenario)
    }

    /// The errors of each scenario. `None` if a value of the answer is not finite.
    fn score(
        &self,
        answer: &Answer,
        patch: Option<usize>,
        scenario: usize,
    ) -> Option<ScenarioErrors> {
        let of_scenario = scenario * self.row..(scenario + 1) * self.row;
        let truth = &self.truth[of_scenario.clone()];
        let predicted = &answer.positions[of_scenario.clone()];
        let samples: Vec<&[f32]> = match &answer.samples {
            Some(samples) => samples
                .positions
                .chunks_exact(self.truth.len())
                .map(|sample| &sample[of_scenario.clone()])
                .collect(),
            None => Vec::new(),
        };
        let mut answered = samples.iter().copied().chain([predicted]).flatten();
        answered.all(|value| value.is_finite()).then(|| {
            let scored_as = ScoredAs {
                joints: self.joints,
                patch,
                limits_rad: self.limits_rad,
                horizons: self.horizons,
                meter: self.meter.as_ref(),
            };
            ScenarioErrors::new(truth, predicted, &samples, scored_as)
        })
    }
}

/// Mean of each number over the scenarios with an answer. Empty without samples.
fn mean_over_scenarios(
    scenarios: &[Option<ScenarioErrors>],
    of: impl Fn(&ScenarioErrors) -> &[f32],
) -> Vec<f64> {
    let of_each: Vec<&[f32]> = scenarios.iter().flatten().map(of).collect();
    let numbers = of_each.first().map_or(0, |numbers| numbers.len());
    let mean = |k: usize| {
        of_each.iter().map(|numbers| f64::from(numbers[k])).sum::<f64>() / of_each.len() as f64
    };
    (0..numbers).map(mean).collect()
}

fn step_coverage(scenarios: &[Option<ScenarioErrors>]) -> Vec<Vec<f64>> {
    let intervals =
        scenarios.iter().flatten().next().map_or(0, |errors| errors.step_coverage.len());
    let of = |k: usize| mean_over_scenarios(scenarios, |errors| &errors.step_coverage[k]);
    (0..intervals).map(of).collect()
}

#[cfg(test)]
mod tests;

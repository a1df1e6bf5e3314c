//! The report of an evaluation from the results of its cells.

use models::Interrupt;
use rayon::prelude::*;
use spec::{Bootstrap, Excitation, Given};
use wire::{
    CellSummary, DataNoise, FailureSummary, GroupSummary, PairedDifference, PredictorInfo,
    PredictorKind, PredictorSummary, Report, RolloutSummary, Shift, TrainedOn, Warning, WorstCase,
    at_noise,
};

use super::by_shift::by_shift;
use super::comparisons::{is_compared, paired_difference, rmse_deg};
use super::replications::over_horizons;
use super::scores::scores;
use super::shift::{common, shift};
use crate::bootstrap::stratified_mean;
use crate::{CellResult, EvaluationError, PredictorErrors, Rollouts};

/// Number of worst scenarios that are listed for each predictor.
const WORST: usize = 10;

/// The question of an evaluation.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// Number of observed samples.
    pub context: u32,
    /// Number of predicted samples.
    pub horizon: u32,
    /// Samples per second.
    pub rate_hz: f64,
    /// Number of samples that are drawn from each generative predictor.
    pub samples: u32,
    /// The signals that predictors are given over context and horizon.
    pub given: Given,
    /// The noise of the data itself; `None` without noise.
    pub data_noise: Option<DataNoise>,
    /// Seed of the dataset's simulation; `None` for recordings.
    pub seed: Option<u64>,
    /// How intervals are resampled.
    pub bootstrap: Bootstrap,
    /// The data's excitation, where it is simulated.
    pub excitation: Option<Excitation>,
    /// The predictors in the order of every table, baselines first.
    pub predictors: Vec<PredictorInfo>,
    /// One list per checkpoint.
    pub trained_on: Vec<Vec<TrainedOn>>,
}

/// Combines the cells of an evaluation.
///
/// A cell is in distribution if every checkpoint's training drew its family, frequency and
/// amplitudes. Without checkpoints all cells are out of distribution. A cell without a frequency is
/// neither.
///
/// # Errors
/// [`EvaluationError::MissingCell`] if a cell has no result.
pub fn summarize(setting: Setting, results: &[CellResult]) -> Result<Report, EvaluationError> {
    if let Some(missing) = (0..results.len()).find(|&k| results[k].cell != k) {
        return Err(EvaluationError::MissingCell(missing));
    }
    let Setting { predictors, trained_on, bootstrap, excitation, .. } = setting;
    let shift = |cell: &CellResult| shift(cell, &trained_on, excitation.as_ref());
    let is_seen = |cell: &CellResult| shift(cell) == Some(Shift::Within);
    let (gridded, others): (Vec<&CellResult>, Vec<&CellResult>) =
        results.iter().partition(|cell| cell.frequency_hz.is_some());
    let (inside, outside): (Vec<&CellResult>, Vec<&CellResult>) =
        gridded.into_iter().partition(|cell| is_seen(cell));
    let groups =
        [("in distribution", inside), ("out of distribution", outside), ("all scenarios", others)];
    let levels = levels(results);
    let groups: Vec<Group<'_>> = levels
        .iter()
        .flat_map(|&level| groups.iter().map(move |(name, cells)| Group::new(name, cells, level)))
        .filter(|group| !group.cells.is_empty())
        .collect();

    let interrupt = Interrupt::current();
    let cells = results
        .par_iter()
        .inspect(|_| interrupt.leave_if_raised())
        .map(|cell| CellSummary {
            family: cell.family,
            frequency_hz: cell.frequency_hz,
            position_noise_rad: cell.position_noise_rad,
            in_distribution: is_seen(cell),
            shift: shift(cell),
            within_torque_limits: cell.share_within_torque_limits(),
            scenarios: cell.scenarios() as u64,
            rmse_deg: means(&predictors, &[cell], bootstrap),
            scores: scores(&predictors, &[cell], bootstrap),
            rollouts: rollouts(&predictors, &[cell]),
            measured_jitter_deg: cell.measured_jitter_deg,
            measured_left_limits: cell.measured_left_limits,
        })
        .collect();
    let shifted: Vec<_> = results.iter().map(|cell| (cell, shift(cell))).collect();
    let paired = groups.iter().flat_map(|group| paired(group, &predictors, bootstrap));
    let worst = predictors.iter().flat_map(|info| worst(&info.name, results, setting.seed));
    Ok(Report {
        context: setting.context,
        horizon: setting.horizon,
        rate_hz: setting.rate_hz,
        samples: setting.samples,
        given: setting.given,
        data_noise: setting.data_noise,
        bootstrap,
        in_distribution: common(&trained_on),
        cells,
        paired: paired.collect(),
        groups: groups
            .par_iter()
            .inspect(|_| interrupt.leave_if_raised())
            .map(|Group { name, position_noise_rad, cells }| {
                let (replications, replication_differences) =
                    over_horizons(&predictors, cells, bootstrap);
                GroupSummary {
                    name: name.clone(),
                    position_noise_rad: *position_noise_rad,
                    scenarios: cells.iter().map(|cell| cell.scenarios() as u64).sum(),
                    rmse_deg: means(&predictors, cells, bootstrap),
                    scores: scores(&predictors, cells, bootstrap),
                    rollouts: rollouts(&predictors, cells),
                    replications,
                    replication_differences,
                }
            })
            .collect(),
        shifts: by_shift(&predictors, &shifted, &levels, bootstrap),
        failures: results.iter().flat_map(failures).collect(),
        worst: worst.collect(),
        warnings: Warning::merge(results.iter().flat_map(|cell| cell.warnings.iter().cloned())),
        predictors,
    })
}

/// Cells at one level of noise with a common summary.
struct Group<'a> {
    name: String,
    position_noise_rad: f64,
    cells: Vec<&'a CellResult>,
}

impl<'a> Group<'a> {
    /// The group of those `cells` that have the noise `level`.
    fn new(name: &str, cells: &[&'a CellResult], level: f64) -> Self {
        Self {
            name: format!("{name}{}", at_noise(level)),
            position_noise_rad: level,
            cells: cells.iter().copied().filter(|cell| cell.position_noise_rad == level).collect(),
        }
    }
}

/// The levels of noise, in order of appearance.
fn levels(results: &[CellResult]) -> Vec<f64> {
    let mut levels = Vec::new();
    for cell in results {
        if !levels.contains(&cell.position_noise_rad) {
            levels.push(cell.position_noise_rad);
        }
    }
    levels
}

/// The mean RMSE of the predictors that answered everything.
fn means(
    predictors: &[PredictorInfo],
    cells: &[&CellResult],
    bootstrap: Bootstrap,
) -> Vec<PredictorSummary> {
    let summary = |info: &PredictorInfo| {
        let interval = stratified_mean(&rmse_deg(cells, &info.name)?, bootstrap);
        Some(PredictorSummary { predictor: info.name.clone(), interval })
    };
    predictors.iter().filter_map(summary).collect()
}

/// The differences between each model, which is a checkpoint or a file of predictions, and the
/// predictors before it. Without models, the differences between baselines.
fn paired(
    group: &Group<'_>,
    predictors: &[PredictorInfo],
    bootstrap: Bootstrap,
) -> Vec<PairedDifference> {
    let is_model = |info: &PredictorInfo| info.kind != PredictorKind::Baseline;
    let only_baselines = !predictors.iter().any(is_model);
    let pairs: Vec<_> = predictors
        .iter()
        .enumerate()
        .filter(|(_, ours)| only_baselines || is_model(ours))
        .flat_map(|(k, ours)| predictors[..k].iter().map(move |theirs| (ours, theirs)))
        .filter(|(ours, theirs)| is_compared(ours, theirs, predictors))
        .collect();
    pairs
        .into_par_iter()
        .filter_map(|(ours, theirs)| {
            Some(PairedDifference {
                group: group.name.clone(),
                position_noise_rad: group.position_noise_rad,
                predictor: ours.name.clone(),
                against: theirs.name.clone(),
                difference_deg: paired_difference(
                    &group.cells,
                    &ours.name,
                    &theirs.name,
                    bootstrap,
                )?,
            })
        })
        .collect()
}

/// Summaries of the predictors that occur in all cells and did not fail on a whole cell.
fn rollouts(predictors: &[PredictorInfo], cells: &[&CellResult]) -> Vec<RolloutSummary> {
    let summary = |info: &PredictorInfo| {
        let asked: Vec<&PredictorErrors> =
            cells.iter().map(|cell| cell.errors(&info.name)).collect::<Option<_>>()?;
        let found: Vec<Rollouts> =
            asked.iter().map(|errors| errors.rollouts).collect::<Option<_>>()?;
        let scenarios: usize = asked.iter().map(|errors| errors.rmse_deg.len()).sum();
        let share = |count: usize| count as f64 / scenarios.max(1) as f64;
        let left: Option<usize> = found.iter().map(|rollouts| rollouts.left_limits).sum();
        Some(RolloutSummary {
            predictor: info.name.clone(),
            left_limits: left.map(share),
            diverged: share(found.iter().map(|rollouts| rollouts.diverged).sum()),
        })
    };
    predictors.iter().filter_map(summary).collect()
}

fn failures(cell: &CellResult) -> impl Iterator<Item = FailureSummary> {
    cell.predictors.iter().filter_map(|errors| {
        let failure = errors.failure.as_ref()?;
        Some(FailureSummary {
            predictor: errors.predictor.clone(),
            family: cell.family,
            frequency_hz: cell.frequency_hz,
            position_noise_rad: cell.position_noise_rad,
            scenarios: failure.scenarios as u64,
            first: cell.first + failure.first as u64,
            reason: failure.reason.clone(),
        })
    })
}

fn worst(predictor: &str, results: &[CellResult], seed: Option<u64>) -> Vec<WorstCase> {
    let mut cases: Vec<WorstCase> = results
        .iter()
        .filter_map(|cell| Some((cell, cell.errors(predictor)?)))
        .flat_map(|(cell, errors)| {
            errors.rmse_deg.iter().enumerate().filter_map(move |(scenario, rmse)| {
                Some(WorstCase {
                    predictor: predictor.to_owned(),
                    family: cell.family,
                    frequency_hz: cell.frequency_hz,
                    position_noise_rad: cell.position_noise_rad,
                    trajectory: cell.first + scenario as u64,
                    seed,
                    rmse_deg: (*rmse)?,
                })
            })
        })
        .collect();
    cases.sort_by(|a, b| b.rmse_deg.total_cmp(&a.rmse_deg));
    cases.truncate(WORST);
    cases
}

//! Differences between predictors on the same scenarios, and which of them a report has.

use spec::{Bootstrap, Start};
use wire::{Interval, PredictorInfo};

use crate::CellResult;
use crate::bootstrap::stratified_mean;

/// Whether a report has the difference between two predictors. `theirs` comes before `ours` in every
/// table.
///
/// Checkpoints that are sampled in several ways would have thousands of pairs. Those are left out
/// that differ in both, the checkpoint and the way of sampling, and pairs of one checkpoint that
/// differ in steps and in the rest.
pub(super) fn is_compared(
    ours: &PredictorInfo,
    theirs: &PredictorInfo,
    predictors: &[PredictorInfo],
) -> bool {
    differ_in_one_respect(ours, theirs) || is_longest_chain(theirs, ours, predictors)
}

/// Whether two predictors differ in the checkpoint alone, in the number of steps alone, or in the
/// rest of the sampling alone.
fn differ_in_one_respect(ours: &PredictorInfo, theirs: &PredictorInfo) -> bool {
    let (Some(a), Some(b)) = (&ours.sampling, &theirs.sampling) else { return true };
    let same_sampling = (a.kind, a.steps, a.start) == (b.kind, b.steps, b.start);
    same_sampling || ours.digest == theirs.digest && (a.curve == b.curve || a.steps == b.steps)
}

/// Whether `chain` is the longest cold chain of the checkpoint of `ours` with the same kind of
/// sampler.
fn is_longest_chain(
    chain: &PredictorInfo,
    ours: &PredictorInfo,
    predictors: &[PredictorInfo],
) -> bool {
    let cold_steps = |info: &PredictorInfo| {
        let (theirs, ours) = (info.sampling.as_ref()?, ours.sampling.as_ref()?);
        (theirs.start == Start::Cold && theirs.kind == ours.kind).then_some(theirs.steps)
    };
    let same_checkpoint = predictors.iter().filter(|info| info.digest == ours.digest);
    let longest = same_checkpoint.filter_map(cold_steps).max();
    chain.digest == ours.digest && longest.is_some() && cold_steps(chain) == longest
}

/// Mean RMSE of `predictor` minus that of `against` over the scenarios of `cells`. A negative value
/// is better. `None` if either has no answer to some of them.
pub fn paired_difference(
    cells: &[&CellResult],
    predictor: &str,
    against: &str,
    bootstrap: Bootstrap,
) -> Option<Interval> {
    let (ours, theirs) = (rmse_deg(cells, predictor)?, rmse_deg(cells, against)?);
    let differences: Vec<Vec<f64>> = ours
        .iter()
        .zip(theirs)
        .map(|(ours, theirs)| ours.iter().zip(theirs).map(|(a, b)| a - b).collect())
        .collect();
    Some(stratified_mean(&differences, bootstrap))
}

/// The errors of one predictor, with a stratum per cell. `None` unless it answered everything.
pub(super) fn rmse_deg(cells: &[&CellResult], predictor: &str) -> Option<Vec<Vec<f64>>> {
    cells.iter().map(|cell| cell.errors(predictor)?.rmse_deg.iter().copied().collect()).collect()
}

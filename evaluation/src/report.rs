//! What an evaluation found: every number with its interval, in and out of distribution apart.

use serde::{Deserialize, Serialize};
use spec::{Bootstrap, Digest, Excitation, Family, Normalization, Range};

use crate::{CellResult, EvaluationError, Interval, stratified_mean};

/// The result of an evaluation, as it is stored, shown and downloaded.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Samples every predictor was given, and samples it was asked for.
    pub context: u32,
    pub horizon: u32,
    pub rate_hz: f64,
    pub bootstrap: Bootstrap,
    pub predictors: Vec<PredictorInfo>,
    /// What the checkpoints were trained on; cells inside are "in distribution".
    pub in_distribution: Vec<TrainedOn>,
    pub cells: Vec<CellSummary>,
    pub groups: Vec<GroupSummary>,
    pub paired: Vec<PairedDifference>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PredictorInfo {
    pub name: String,
    pub kind: PredictorKind,
    /// Digest of the training's spec.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub digest: Option<Digest>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub normalization: Option<Normalization>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PredictorKind {
    Baseline,
    Checkpoint,
}

/// Master frequencies of one family that training drew from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainedOn {
    pub family: Family,
    pub frequency_hz: Range,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CellSummary {
    pub family: Family,
    pub frequency_hz: f64,
    pub in_distribution: bool,
    pub scenarios: usize,
    pub rmse_deg: Vec<PredictorSummary>,
}

/// Mean RMSE over scenarios, in degrees.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PredictorSummary {
    pub predictor: String,
    #[serde(flatten)]
    pub interval: Interval,
}

/// All cells in distribution, or all out of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GroupSummary {
    pub name: String,
    pub scenarios: usize,
    pub rmse_deg: Vec<PredictorSummary>,
}

/// RMSE of `predictor` minus that of `against` on the same scenarios; below 0 is better.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PairedDifference {
    pub group: String,
    pub predictor: String,
    pub against: String,
    pub difference_deg: Interval,
}

impl TrainedOn {
    /// What a training on `excitation` has seen.
    pub fn of(excitation: &Excitation) -> impl Iterator<Item = Self> {
        [Family::Chirp, Family::Multisine].into_iter().filter_map(|family| {
            excitation.support(family).map(|frequency_hz| Self { family, frequency_hz })
        })
    }

    fn includes(&self, cell: &CellResult) -> bool {
        // Grids are written in decimals, so 0.1 + 0.05 must count as 0.15.
        const TOLERANCE_HZ: f64 = 1e-9;
        self.family == cell.family
            && cell.frequency_hz >= self.frequency_hz.min - TOLERANCE_HZ
            && cell.frequency_hz <= self.frequency_hz.max + TOLERANCE_HZ
    }
}

/// Puts the cells of an evaluation together.
///
/// A cell is in distribution when every checkpoint's training drew its family and frequency.
/// `trained_on` has one list per checkpoint; without checkpoints all cells are out of it.
///
/// # Errors
/// [`EvaluationError::MissingCell`] when a cell has no result.
pub fn summarize(
    context: u32,
    samples: u32,
    rate_hz: f64,
    bootstrap: Bootstrap,
    predictors: Vec<PredictorInfo>,
    trained_on: &[Vec<TrainedOn>],
    results: &[CellResult],
) -> Result<Report, EvaluationError> {
    if let Some(missing) = (0..results.len()).find(|&k| results[k].cell != k) {
        return Err(EvaluationError::MissingCell(missing));
    }
    let is_seen = |cell: &CellResult| {
        !trained_on.is_empty()
            && trained_on.iter().all(|seen| seen.iter().any(|seen| seen.includes(cell)))
    };
    let (inside, outside): (Vec<&CellResult>, Vec<&CellResult>) =
        results.iter().partition(|cell| is_seen(cell));
    let groups = [("in distribution", inside), ("out of distribution", outside)];
    let groups: Vec<_> = groups.into_iter().filter(|(_, cells)| !cells.is_empty()).collect();

    let cells = results
        .iter()
        .map(|cell| CellSummary {
            family: cell.family,
            frequency_hz: cell.frequency_hz,
            in_distribution: is_seen(cell),
            scenarios: scenarios(cell),
            rmse_deg: means(&predictors, &[cell], bootstrap),
        })
        .collect();
    let paired =
        groups.iter().flat_map(|(name, cells)| paired(name, &predictors, cells, bootstrap));
    Ok(Report {
        context,
        horizon: samples - context,
        rate_hz,
        bootstrap,
        in_distribution: common(trained_on),
        cells,
        paired: paired.collect(),
        groups: groups
            .iter()
            .map(|(name, cells)| GroupSummary {
                name: (*name).to_owned(),
                scenarios: cells.iter().map(|cell| scenarios(cell)).sum(),
                rmse_deg: means(&predictors, cells, bootstrap),
            })
            .collect(),
        predictors,
    })
}

fn scenarios(cell: &CellResult) -> usize {
    cell.predictors.first().map_or(0, |errors| errors.rmse_deg.len())
}

fn means(
    predictors: &[PredictorInfo],
    cells: &[&CellResult],
    bootstrap: Bootstrap,
) -> Vec<PredictorSummary> {
    predictors
        .iter()
        .map(|info| PredictorSummary {
            predictor: info.name.clone(),
            interval: stratified_mean(&errors(cells, &info.name), bootstrap),
        })
        .collect()
}

/// Each checkpoint against each baseline, on the same scenarios.
fn paired(
    group: &str,
    predictors: &[PredictorInfo],
    cells: &[&CellResult],
    bootstrap: Bootstrap,
) -> Vec<PairedDifference> {
    let of_kind = |kind| predictors.iter().filter(move |info| info.kind == kind);
    of_kind(PredictorKind::Checkpoint)
        .flat_map(|ours| of_kind(PredictorKind::Baseline).map(move |theirs| (ours, theirs)))
        .map(|(ours, theirs)| {
            let differences: Vec<Vec<f64>> = errors(cells, &ours.name)
                .iter()
                .zip(errors(cells, &theirs.name))
                .map(|(ours, theirs)| ours.iter().zip(theirs).map(|(a, b)| a - b).collect())
                .collect();
            PairedDifference {
                group: group.to_owned(),
                predictor: ours.name.clone(),
                against: theirs.name.clone(),
                difference_deg: stratified_mean(&differences, bootstrap),
            }
        })
        .collect()
}

/// One predictor's errors, a stratum per cell.
fn errors(cells: &[&CellResult], predictor: &str) -> Vec<Vec<f64>> {
    cells
        .iter()
        .map(|cell| {
            let found = cell.predictors.iter().find(|errors| errors.predictor == predictor);
            found.map(|errors| errors.rmse_deg.clone()).unwrap_or_default()
        })
        .collect()
}

/// What all trainings have seen: the intersection of their intervals, per family.
fn common(trained_on: &[Vec<TrainedOn>]) -> Vec<TrainedOn> {
    let Some((first, others)) = trained_on.split_first() else { return Vec::new() };
    first
        .iter()
        .filter_map(|seen| {
            others.iter().try_fold(*seen, |common, other| {
                let other = other.iter().find(|other| other.family == common.family)?;
                let min = common.frequency_hz.min.max(other.frequency_hz.min);
                let max = common.frequency_hz.max.min(other.frequency_hz.max);
                (min <= max).then_some(TrainedOn { frequency_hz: Range { min, max }, ..common })
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn info(name: &str, kind: PredictorKind) -> PredictorInfo {
        PredictorInfo { name: name.to_owned(), kind, digest: None, normalization: None }
    }

    fn cell(cell: usize, frequency_hz: f64, model: f64, baseline: f64) -> CellResult {
        let errors = |predictor: &str, value: f64| crate::PredictorErrors {
            predictor: predictor.to_owned(),
            rmse_deg: vec![value - 0.1, value + 0.1],
        };
        CellResult {
            cell,
            family: Family::Multisine,
            frequency_hz,
            first: 2 * cell as u64,
            predictors: vec![errors("model", model), errors("baseline", baseline)],
        }
    }

    fn report(results: &[CellResult]) -> Result<Report, EvaluationError> {
        let trained_on =
            TrainedOn { family: Family::Multisine, frequency_hz: Range::new(0.15, 0.15) };
        let predictors = vec![
            info("model", PredictorKind::Checkpoint),
            info("baseline", PredictorKind::Baseline),
        ];
        summarize(320, 400, 60.0, Bootstrap::default(), predictors, &[vec![trained_on]], results)
    }

    #[test]
    fn in_and_out_of_distribution_are_kept_apart() {
        let results = [cell(0, 0.1 + 0.05, 1.0, 2.0), cell(1, 0.3, 5.0, 4.0)];
        let report = report(&results).unwrap();
        let mean = |group: usize, predictor: usize| {
            (report.groups[group].rmse_deg[predictor].interval.mean * 1e6).round() / 1e6
        };
        assert_eq!(report.groups[0].name, "in distribution");
        assert_eq!([mean(0, 0), mean(0, 1), mean(1, 0), mean(1, 1)], [1.0, 2.0, 5.0, 4.0]);
    }

    #[test]
    fn paired_differences_cancel_what_is_common_to_a_scenario() {
        let report = report(&[cell(0, 0.15, 1.0, 2.0)]).unwrap();
        let difference = &report.paired[0].difference_deg;
        assert!((difference.low + 1.0).abs() < 1e-9 && (difference.high + 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_missing_cell_is_an_error() {
        let error = report(&[cell(1, 0.15, 1.0, 2.0)]).unwrap_err();
        assert!(matches!(error, EvaluationError::MissingCell(0)));
    }

    #[test]
    fn a_report_reads_back_from_its_json() {
        let report = report(&[cell(0, 0.15, 1.0, 2.0)]).unwrap();
        let text = serde_json::to_string(&report).unwrap();
        assert_eq!(serde_json::from_str::<Report>(&text).unwrap(), report);
    }
}

//! The paper's three claims and the baselines without training, compared with the measurements.

use spec::{Start, StudyQuestion, study_models};
use wire::{Latency, PredictorInfo, Report, Unit};

use crate::numbers::degrees;
use crate::{Cell, ComparisonOutcome, TableOf};

use super::super::results::{Evaluation, Study};
use super::columns::{COLUMNS, ShiftColumn};
use super::errors::{IN_DISTRIBUTION, OUT_OF_DISTRIBUTION, difference, rmse};

/// The deterministic model of the paper's comparison.
const REFERENCE: &str = "robomorph";
/// The model that uses inpainting.
const INPAINTING: &str = "diffuser";
/// The paper's time limit for one prediction.
const BUDGET_MS: f64 = 40.0;
/// Number of passes that fit into the limit in the paper.
const FEW_STEPS: u32 = 5;

/// How often one model was better and worse than another one.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    better: usize,
    worse: usize,
    all: usize,
}

impl Tally {
    /// Counts over all training sets that have both models.
    fn of(study: &Study, column: &ShiftColumn, name: &str, against: &str) -> Self {
        let mut tally = Self::default();
        for set in 1..=study.sets() {
            let Some(interval) = column.difference(study, set, name, against) else { continue };
            tally.all += 1;
            match ComparisonOutcome::of_interval(interval) {
                ComparisonOutcome::Better => tally.better += 1,
                ComparisonOutcome::Worse => tally.worse += 1,
                ComparisonOutcome::NotClear | ComparisonOutcome::TooFew => {}
            }
        }
        tally
    }

    /// `None` if no training set has both models.
    fn words(self) -> Option<String> {
        let Self { better, worse, all } = self;
        (all > 0).then(|| format!("{better} better, {worse} worse of {all}"))
    }
}

/// For each of `names`, the number of sets on which it is better and worse than `against`, by
/// column.
fn outcomes<'a>(study: &Study, names: impl Iterator<Item = &'a str>, against: &[&str]) -> String {
    let pairs = names.flat_map(|name| against.iter().map(move |against| (name, *against)));
    let pairs = TableOf::new(pairs.filter(|(name, against)| name != against))
        .text("", |(name, _)| *name)
        .text("against", |(_, against)| *against);
    let with_columns = COLUMNS.iter().fold(pairs, |table, column| {
        let tally = |name: &str, against: &str| Tally::of(study, column, name, against).words();
        table.text(column.title, |(name, against)| tally(name, against))
    });
    with_columns.to_markdown()
}

/// "Diffusion models hold up out of distribution, where the deterministic model degrades."
pub fn robustness(study: &Study) -> String {
    let generative = study_models().iter().filter(|model| model.samples);
    outcomes(study, generative.map(|model| model.name.as_str()), &[REFERENCE])
}

/// Baselines without training, which a model has to beat.
const UNTRAINED: [&str; 3] = ["damped-integrator", "arx", "simulator-fitted-damping"];

/// How every model compares with baselines on the training sets.
pub fn against_baselines(study: &Study) -> String {
    outcomes(study, study_models().iter().map(|model| model.name.as_str()), &UNTRAINED)
}

/// "Inpainting (Diffuser) is the best of the diffusion models."
pub fn inpainting(study: &Study) -> String {
    let others: Vec<&str> = study_models()
        .iter()
        .filter(|model| model.denoiser && model.name != INPAINTING)
        .map(|model| model.name.as_str())
        .collect();
    outcomes(study, [INPAINTING].into_iter(), &others)
}

/// "Warm-started conditioned diffusion predicts within 40 ms at little cost in accuracy."
pub fn warm_start(study: &Study) -> String {
    let Some(evaluation) = study.warm_start() else { return String::new() };
    let report = &evaluation.report;
    let mut text = String::new();
    let mut rows = Vec::new();
    for model in study_models().iter().filter(|model| model.denoiser) {
        let model = model.name.as_str();
        let of_model: Vec<&PredictorInfo> =
            report.predictors.iter().filter(|info| study.name_of(info) == model).collect();
        let find = |start: Start, steps: u32| {
            of_model.iter().copied().find(|info| {
                info.sampling
                    .as_ref()
                    .is_some_and(|sampling| sampling.start == start && sampling.steps == steps)
            })
        };
        let all = of_model.iter().filter_map(|info| Some(info.sampling.as_ref()?.steps)).max();
        let all = all.unwrap_or(FEW_STEPS);
        for (start, steps) in [
            (Start::Cold, all),
            (Start::Cold, FEW_STEPS),
            (Start::Shifted, FEW_STEPS),
            (Start::Oracle, FEW_STEPS),
        ] {
            let Some(info) = find(start, steps) else { continue };
            rows.push(WarmStart { model, info, start, steps });
        }
        if let Some(shifted) = find(Start::Shifted, FEW_STEPS) {
            text += &sentence(
                report,
                model,
                shifted,
                find(Start::Cold, all),
                find(Start::Cold, FEW_STEPS),
            );
        }
    }
    format!("{text}\n{}", warm_starts(report, rows))
}

/// A table of denoisers, each sampled in one way.
fn warm_starts(report: &Report, rows: Vec<WarmStart<'_>>) -> String {
    let error = |row: &WarmStart<'_>, group: &str| {
        Some(Cell::Interval(rmse(report, group, &row.info.name)?, Unit::Degrees))
    };
    let ms = |row: &WarmStart<'_>, of: fn(&Latency) -> f64| {
        row.info.latency.as_ref().map(|latency| format!("{:.1} ms", of(latency)))
    };
    let is_within = |latency: &Latency| if latency.p99_ms <= BUDGET_MS { "yes" } else { "no" };
    let leak = |start| if start == Start::Oracle { " (knows the future)" } else { "" };
    TableOf::new(rows)
        .text("predictor", |row| row.model)
        .text("start", |row| format!("{}{}", row.start, leak(row.start)))
        .text("steps", |row| row.steps.to_string())
        .text("RMSE in distribution", |row| error(row, IN_DISTRIBUTION))
        .text("RMSE out of it", |row| error(row, OUT_OF_DISTRIBUTION))
        .text("median", |row| ms(row, |latency| latency.median_ms))
        .text("p99", |row| ms(row, |latency| latency.p99_ms))
        .text("within 40 ms", |row| row.info.latency.as_ref().map(is_within))
        .to_markdown()
}

/// A denoiser that is sampled in one way.
struct WarmStart<'a> {
    model: &'a str,
    info: &'a PredictorInfo,
    start: Start,
    steps: u32,
}

/// The cost and the accuracy of five warm steps, compared with all steps and with five cold steps.
fn sentence(
    report: &Report,
    model: &str,
    shifted: &PredictorInfo,
    all: Option<&PredictorInfo>,
    cold: Option<&PredictorInfo>,
) -> String {
    let mut clauses = Vec::new();
    if let Some(latency) = &shifted.latency {
        let fits = if latency.p99_ms <= BUDGET_MS { "within" } else { "beyond" };
        clauses.push(format!(
            "p99 {:.1} ms on {} threads, {fits} {BUDGET_MS} ms",
            latency.p99_ms, latency.threads
        ));
    }
    for (against, words) in [(all, "all steps from noise"), (cold, "as many steps from noise")] {
        let Some(against) = against else { continue };
        for group in [IN_DISTRIBUTION, OUT_OF_DISTRIBUTION] {
            let Some(interval) = difference(report, group, &shifted.name, &against.name) else {
                continue;
            };
            let outcome = ComparisonOutcome::of_interval(interval).words();
            clauses.push(format!(
                "{outcome} {words} {group} ({} [{}, {}])",
                degrees(interval.mean),
                degrees(interval.low),
                degrees(interval.high)
            ));
        }
    }
    format!("- `{model}`, {FEW_STEPS} warm-started steps: {}.\n", clauses.join("; "))
}

impl Study {
    pub(super) fn warm_start(&self) -> Option<&Evaluation> {
        let mut evaluations = self.evaluations.iter();
        evaluations.find(|evaluation| evaluation.plan.question == StudyQuestion::WarmStart)
    }
}

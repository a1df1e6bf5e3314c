//! The paper's three claims beside what was measured.

use std::fmt::Write;

use spec::Start;
use wire::{Interval, Latency, PredictorInfo, Report};

use crate::{Standing, degrees};

use super::super::results::{DENOISERS, MODELS, REFERENCE, Set, Study};
use super::errors::{IN_DISTRIBUTION, OUT_OF_DISTRIBUTION, difference, rmse};
use super::figures::{baselines, error};
use super::text::{markdown, with_interval};

/// What the paper allows one prediction to take.
const BUDGET_MS: f64 = 40.0;
/// Passes that fit into it there.
const FEW_STEPS: u32 = 5;

/// How often one model was better and worse than another.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    better: usize,
    worse: usize,
    all: usize,
}

impl Tally {
    fn count(&mut self, standing: Standing) {
        self.all += 1;
        match standing {
            Standing::Better => self.better += 1,
            Standing::Worse => self.worse += 1,
            Standing::NotClear => {}
        }
    }

    fn words(self) -> String {
        let Self { better, worse, all } = self;
        let rest = all - better - worse;
        format!("better on {better} of {all}, worse on {worse}, not clearly different on {rest}")
    }
}

/// Difference of RMSE between two models of a set on its sweep.
fn between(set: &Set, group: &str, model: &str, against: &str) -> Option<Interval> {
    let report = &set.sweep.report;
    let (model, against) = (set.predictor(report, model)?, set.predictor(report, against)?);
    difference(report, group, &model.name, &against.name)
}

/// "Diffusion models hold up out of distribution, where the deterministic model degrades."
pub fn robustness(study: &Study) -> String {
    let mut rows = Vec::new();
    let mut tallies = vec![Tally::default(); MODELS.len()];
    for set in &study.sets {
        for (k, model) in MODELS.into_iter().enumerate() {
            let inside = error(set, IN_DISTRIBUTION, model);
            let outside = error(set, OUT_OF_DISTRIBUTION, model);
            let gap = inside.zip(outside).map(|(inside, outside)| outside.mean / inside.mean);
            let against = between(set, OUT_OF_DISTRIBUTION, model, REFERENCE);
            let standing = against.map(Standing::of);
            if let Some(standing) = standing {
                tallies[k].count(standing);
            }
            rows.push(vec![
                set.name.clone(),
                model.to_owned(),
                inside.map_or_else(none, with_interval),
                outside.map_or_else(none, with_interval),
                gap.map_or_else(none, |gap| format!("{gap:.1}×")),
                against.map_or_else(none, with_interval),
                standing.map_or_else(String::new, |standing| standing.word().to_owned()),
            ]);
        }
        for baseline in baselines(set) {
            rows.push(vec![
                set.name.clone(),
                format!("*{baseline}*"),
                error(set, IN_DISTRIBUTION, baseline).map_or_else(none, with_interval),
                error(set, OUT_OF_DISTRIBUTION, baseline).map_or_else(none, with_interval),
                String::new(),
                String::new(),
                String::new(),
            ]);
        }
    }
    let columns = [
        "trained on",
        "predictor",
        "RMSE in distribution",
        "RMSE out of it",
        "ratio",
        "out of it, less robomorph's",
        "",
    ];
    let mut text = String::new();
    for (model, tally) in MODELS.into_iter().zip(&tallies).filter(|(model, _)| *model != REFERENCE)
    {
        let _ = writeln!(
            text,
            "- `{model}` against `{REFERENCE}` out of distribution: {} training sets.",
            tally.words()
        );
    }
    format!("{text}\n{}", markdown(&columns, &rows))
}

/// What needs no training, beside which a model has to show what it is worth.
const UNTRAINED: [&str; 3] = ["damped-integrator", "arx", "identification"];

/// How every model stands against baselines on the training sets.
pub fn against_baselines(study: &Study) -> String {
    let mut rows = Vec::new();
    for model in MODELS {
        for group in [IN_DISTRIBUTION, OUT_OF_DISTRIBUTION] {
            let against = |baseline: &str| {
                let mut tally = Tally::default();
                let differences =
                    study.sets.iter().filter_map(|set| between(set, group, model, baseline));
                differences.for_each(|interval| tally.count(Standing::of(interval)));
                if tally.all == 0 { none() } else { tally.words() }
            };
            let mut row = vec![model.to_owned(), group.to_owned()];
            row.extend(UNTRAINED.map(against));
            rows.push(row);
        }
    }
    let mut columns = vec!["predictor", "cells"];
    columns.extend(UNTRAINED);
    markdown(&columns, &rows)
}

/// "Inpainting (Diffuser) is the best of the diffusion models."
pub fn inpainting(study: &Study) -> String {
    let mut text = String::new();
    let mut rows = Vec::new();
    for group in [IN_DISTRIBUTION, OUT_OF_DISTRIBUTION] {
        for other in DENOISERS.into_iter().filter(|&other| other != "diffuser") {
            let mut tally = Tally::default();
            for set in &study.sets {
                let Some(interval) = between(set, group, "diffuser", other) else { continue };
                tally.count(Standing::of(interval));
                rows.push(vec![
                    set.name.clone(),
                    group.to_owned(),
                    format!("diffuser less {other}"),
                    with_interval(interval),
                    Standing::of(interval).word().to_owned(),
                ]);
            }
            let _ = writeln!(
                text,
                "- `diffuser` against `{other}` {group}: {} training sets.",
                tally.words()
            );
        }
    }
    let columns = ["trained on", "cells", "difference of RMSE", "", "diffuser is"];
    format!("{text}\n{}", markdown(&columns, &rows))
}

/// "Warm-started conditioned diffusion predicts within 40 ms at little cost in accuracy."
pub fn warm_start(study: &Study) -> String {
    let Some(set) = study.warm_start_set() else { return String::new() };
    let report = &study.warm_start.report;
    let mut text = String::new();
    let mut rows = Vec::new();
    for model in DENOISERS {
        let of_model: Vec<&PredictorInfo> =
            report.predictors.iter().filter(|info| set.name_of(info) == model).collect();
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
            rows.push(warm_start_row(report, model, info, start, steps));
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
    let columns = [
        "predictor",
        "start",
        "steps",
        "RMSE in distribution",
        "RMSE out of it",
        "median",
        "p99",
        "within 40 ms",
    ];
    format!("{text}\n{}", markdown(&columns, &rows))
}

fn warm_start_row(
    report: &Report,
    model: &str,
    info: &PredictorInfo,
    start: Start,
    steps: u32,
) -> Vec<String> {
    let latency = info.latency.as_ref();
    let ms = |of: fn(&Latency) -> f64| {
        latency.map_or_else(none, |latency| format!("{:.1} ms", of(latency)))
    };
    let leak = if start == Start::Oracle { " (knows the future)" } else { "" };
    vec![
        model.to_owned(),
        format!("{start}{leak}"),
        steps.to_string(),
        rmse(report, IN_DISTRIBUTION, &info.name).map_or_else(none, with_interval),
        rmse(report, OUT_OF_DISTRIBUTION, &info.name).map_or_else(none, with_interval),
        ms(|latency| latency.median_ms),
        ms(|latency| latency.p99_ms),
        latency.map_or_else(none, |latency| {
            if latency.p99_ms <= BUDGET_MS { "yes" } else { "no" }.to_owned()
        }),
    ]
}

/// What five warm steps cost and give, beside all steps and five cold ones.
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
            let standing = Standing::of(interval).words();
            clauses.push(format!(
                "{standing} {words} {group} ({} [{}, {}])",
                degrees(interval.mean),
                degrees(interval.low),
                degrees(interval.high)
            ));
        }
    }
    format!("- `{model}`, {FEW_STEPS} warm-started steps: {}.\n", clauses.join("; "))
}

fn none() -> String {
    "-".to_owned()
}

//! The figures of the evaluations, and one over all training sets.

use figures::{Axis, Figure, Point, Series, Size};
use wire::{Interval, PredictorKind};

use super::super::results::{Evaluation, File, MODELS, Set, Study};
use super::errors::{IN_DISTRIBUTION, OUT_OF_DISTRIBUTION, rmse};

/// Baselines to compare with; all others are in the tables.
const BASELINES: [&str; 2] = ["damped-integrator", "arx"];

pub fn all(study: &Study) -> anyhow::Result<Vec<File>> {
    let of_sets = study.sets.iter().flat_map(|set| [&set.sweep, &set.samples]);
    let mut files: Vec<File> = of_sets.chain([&study.warm_start]).flat_map(drawn).collect();
    for (group, name) in
        [(IN_DISTRIBUTION, "in-distribution"), (OUT_OF_DISTRIBUTION, "out-of-distribution")]
    {
        let figure = over_training_sets(study, group);
        let svg = figure.to_svg(Size::PAGE)?.into_bytes();
        files.push(File { name: format!("{name}.svg"), bytes: svg });
    }
    Ok(files)
}

/// The figures that an evaluation drew, under its name.
fn drawn(evaluation: &Evaluation) -> impl Iterator<Item = File> {
    let is_figure = |file: &&File| file.name.ends_with(".svg");
    evaluation.files.iter().filter(is_figure).map(|file| File {
        name: format!("{}-{}", evaluation.record.name, file.name),
        bytes: file.bytes.clone(),
    })
}

/// RMSE of every model on what each training set makes in or out of distribution.
fn over_training_sets(study: &Study, group: &str) -> Figure {
    let mut names: Vec<&str> = MODELS.to_vec();
    names.extend(BASELINES);
    let series = names.iter().map(|&name| {
        let points = study.sets.iter().enumerate().filter_map(|(k, set)| {
            let Interval { mean, low, high } = error(set, group, name)?;
            Some(Point::with_interval((k + 1) as f64, mean, low, high))
        });
        let series = Series::line(name, points.collect()).with_markers();
        if BASELINES.contains(&name) { series.dashed() } else { series }
    });
    Figure {
        title: format!("RMSE {group}"),
        x: Axis::linear("trained on D"),
        y: Axis::log("RMSE").in_unit("°"),
        series: series.filter(|series| !series.points.is_empty()).collect(),
        bands: Vec::new(),
    }
}

/// Of a model or a baseline.
pub fn error(set: &Set, group: &str, name: &str) -> Option<Interval> {
    let report = &set.sweep.report;
    let predictor = set.predictor(report, name)?;
    rmse(report, group, &predictor.name)
}

/// The baselines of a set's sweep.
pub fn baselines(set: &Set) -> impl Iterator<Item = &str> {
    let predictors = set.sweep.report.predictors.iter();
    predictors.filter(|info| info.kind == PredictorKind::Baseline).map(|info| info.name.as_str())
}

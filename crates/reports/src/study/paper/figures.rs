//! The figures of the evaluations, and one over all training sets.

use figures::{Axis, Curve, Figure, Point, Size};
use spec::study_models;
use wire::Interval;

use super::super::results::{Evaluation, File, Study};
use super::columns::{COLUMNS, ShiftColumn};

/// Baselines in the figures. The tables have all of them.
const BASELINES: [&str; 3] = ["damped-integrator", "arx", "simulator-fitted-damping"];

/// Drawn columns of the headline table, with the names of their files.
const DRAWN: [(usize, &str); 4] =
    [(0, "within"), (2, "above-chirps"), (3, "above-multisines"), (5, "steps")];

pub fn all(study: &Study) -> anyhow::Result<Vec<File>> {
    let mut files: Vec<File> = study.evaluations.iter().flat_map(drawn).collect();
    for (column, name) in DRAWN {
        let svg = over_training_sets(study, &COLUMNS[column]).to_svg(Size::PAGE)?.into_bytes();
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

/// RMSE of every model and some baselines on each training set, for one column of the headline
/// table.
fn over_training_sets(study: &Study, column: &ShiftColumn) -> Figure {
    let models = study_models().iter().map(|model| model.name.as_str());
    let names: Vec<&str> = models.chain(BASELINES).collect();
    let series = names.iter().map(|&name| {
        let points = (1..=study.sets()).filter_map(|set| {
            let Interval { mean, low, high } = column.scores(study, set, name)?.rmse_deg?;
            // The axis is logarithmic, and an interval over few seeds may reach below 0.
            let low = low.max(0.1 * mean);
            Some(Point::with_interval(set as f64, mean, low, high))
        });
        Curve::line(name, points.collect()).with_markers().of_predictor(name, &names)
    });
    Figure {
        title: format!("RMSE, {}", column.title),
        x: Axis::linear("trained on D"),
        y: Axis::log("RMSE").in_unit("°"),
        series: series.filter(|curve| !curve.points.is_empty()).collect(),
        bands: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixture;
    use super::*;

    #[test]
    fn predictors_have_the_colours_of_the_evaluations() {
        let figure = over_training_sets(&fixture::study(), &COLUMNS[0]);
        for name in ["lagrangian", "arx"] {
            let found = figure.series.iter().find(|curve| curve.name == name);
            assert_eq!(found.unwrap().colour, Some(figures::predictor_colour(name, &[])), "{name}");
        }
    }
}

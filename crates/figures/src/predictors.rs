//! The colour of each predictor, the same in every figure.
//!
//! Evaluations, closed loops, single predictions and studies show the same predictors. A reader who
//! has learned that `robomorph` is bluish green finds it so on every page.

use crate::Curve;
use crate::theme::{COMPARED, MEASURED, compared};

/// Places of architectures among the colours. Those of the usual models are of colours that the
/// usual baselines do not have.
const ARCHITECTURES: [&str; 8] =
    ["lagrangian", "flow", "robomorph", "cdt", "diffuser", "gru", "prefix-transformer", "cdcnn"];

/// Baselines, each with its place from the back and its round. Where a model has the same colour,
/// the marker differs, since baselines come in another round than models. There are fewer colours
/// than baselines, and those that share one have markers of their own.
const BASELINES: [(&str, usize, usize); 13] = [
    ("damped-integrator", 0, 1),
    ("follow-reference", 0, 2),
    ("base-parameters", 0, 3),
    ("hold-last", 1, 1),
    ("zero-torque", 1, 2),
    ("constant-velocity", 2, 1),
    ("arx", 3, 1),
    ("identification", 4, 1),
    ("nominal-simulator", 5, 1),
    ("simulator-fitted-damping", 6, 1),
    ("joint-ekf", 6, 2),
    ("least-squares", 7, 1),
    ("fitted-damping", 8, 1),
];

/// The baseline that is the robot itself. It has the colour of what was measured.
const ORACLE: &str = "oracle";

/// The place in the palette of the predictor `name`. `beside` has the names of all predictors of the
/// figure, with or without `name`.
///
/// A baseline has its own place, and so has a model that is named after its architecture, whatever
/// else is there. Of two models that would have the same, the second takes one that is free. A name
/// that people gave decides by its letters.
#[must_use]
pub fn predictor_colour(name: &str, beside: &[&str]) -> usize {
    if let Some(place) = of_baseline(name) {
        return place;
    }
    let mut models: Vec<&str> = Vec::new();
    for model in beside.iter().filter(|name| of_baseline(name).is_none()) {
        if !models.contains(model) {
            models.push(model);
        }
    }
    let places = places(&models);
    let place = models.iter().zip(places).find(|(model, _)| **model == name);
    compared(place.map_or_else(|| preferred(name), |(_, place)| place))
}

/// Whether `name` is a baseline's.
#[must_use]
pub fn is_baseline(name: &str) -> bool {
    of_baseline(name).is_some()
}

impl Curve {
    /// The series in the colour of the predictor `name`, which stands in a figure with `beside`. A
    /// baseline is dashed.
    #[must_use]
    pub fn of_predictor(self, name: &str, beside: &[&str]) -> Self {
        let curve = self.coloured(predictor_colour(name, beside));
        if is_baseline(name) { curve.dashed() } else { curve }
    }
}

/// The place of each model among the colours. The first of an architecture has the architecture's.
fn places(models: &[&str]) -> Vec<usize> {
    let mut places: Vec<Option<usize>> = vec![None; models.len()];
    for (k, model) in models.iter().enumerate() {
        let preferred = preferred(model);
        if !places.contains(&Some(preferred)) {
            places[k] = Some(preferred);
        }
    }
    for k in 0..places.len() {
        if places[k].is_none() {
            places[k] = (0..).find(|place| !places.contains(&Some(*place)));
        }
    }
    places.into_iter().map(Option::unwrap_or_default).collect()
}

/// The place of a model when no other has taken it.
fn preferred(name: &str) -> usize {
    let architecture = name.split(' ').next().unwrap_or_default();
    let known = ARCHITECTURES.iter().position(|it| *it == architecture);
    // A name that people gave has a colour that depends on nothing else.
    known.unwrap_or_else(|| {
        let sum =
            name.bytes().fold(0, |sum: usize, byte| (31 * sum + usize::from(byte)) % 1_000_003);
        sum % COMPARED.len()
    })
}

/// `None` unless `name` is a baseline's.
fn of_baseline(name: &str) -> Option<usize> {
    if name == ORACLE {
        return Some(MEASURED);
    }
    let (_, place, round) = BASELINES.iter().find(|(baseline, ..)| *baseline == name)?;
    Some(compared(round * COMPARED.len() + COMPARED.len() - 1 - place))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::Stroke;

    /// The colour alone, without its marker.
    fn hue(place: usize) -> usize {
        place % (COMPARED.len() + 1)
    }

    #[test]
    fn a_predictor_has_its_colour_whatever_stands_beside_it() {
        for name in ["hold-last", "lagrangian"] {
            let few = predictor_colour(name, &["hold-last", "lagrangian"]);
            let all = predictor_colour(name, &["cdt", "hold-last", "lagrangian"]);
            assert_eq!(few, all, "{name}");
        }
        let beside = ["cdt", "lagrangian"];
        assert_ne!(predictor_colour("cdt", &beside), predictor_colour("lagrangian", &beside));
    }

    /// The lagrangian and least squares were both orange squares.
    #[test]
    fn no_two_predictors_look_the_same() {
        let names = ["lagrangian 1f", "lagrangian 2a", "mine", "robomorph", "least-squares", "gru"];
        let places: BTreeSet<usize> =
            names.iter().map(|name| predictor_colour(name, &names)).collect();
        assert_eq!(places.len(), names.len());
        // The models of the quickstart and its baselines have eight colours.
        let usual = [
            "robomorph",
            "lagrangian",
            "hold-last",
            "constant-velocity",
            "least-squares",
            "arx",
            "nominal-simulator",
            "identification",
        ];
        let hues: BTreeSet<usize> =
            usual.iter().map(|name| hue(predictor_colour(name, &[]))).collect();
        assert_eq!(hues.len(), usual.len());
    }

    #[test]
    fn models_beyond_the_colours_have_other_markers() {
        let names: Vec<String> = (0..30).map(|k| format!("lagrangian {k}")).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let places: BTreeSet<usize> =
            names.iter().map(|name| predictor_colour(name, &names)).collect();
        assert_eq!(places.len(), names.len());
    }

    #[test]
    fn the_controllers_of_a_closed_loop_have_different_colours() {
        let controllers = [
            "zero-torque",
            "damped-integrator",
            "nominal-simulator",
            "identification",
            "oracle",
            "robomorph",
            "lagrangian",
        ];
        let hues: BTreeSet<usize> =
            controllers.iter().map(|name| hue(predictor_colour(name, &controllers))).collect();
        assert_eq!(hues.len(), controllers.len());
    }

    #[test]
    fn every_baseline_has_a_look_of_its_own_and_is_dashed() {
        let places: BTreeSet<Option<usize>> =
            BASELINES.iter().map(|(name, ..)| of_baseline(name)).collect();
        assert_eq!(places.len(), BASELINES.len());
        let stroke = |name: &str| Curve::line(name, Vec::new()).of_predictor(name, &[]).stroke;
        assert_eq!(stroke("arx"), Stroke::Dashed);
        assert_eq!(stroke("robomorph"), Stroke::Solid);
    }
}

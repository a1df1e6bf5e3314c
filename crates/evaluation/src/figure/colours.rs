//! The colour of each predictor, the same in all figures.

use figures::COMPARED;
use serde::Deserialize;
use serde::de::IntoDeserializer;
use serde::de::value::Error;
use spec::Baseline;
use wire::PredictorInfo;

/// The place in the palette of a curve of `name`, which is a predictor's or that of several that
/// differ only in the sampler's steps. A baseline has its own, and so has an architecture, whatever
/// else is there. Of two models that would have the same, the second takes one that is free.
pub fn colour_of(predictors: &[PredictorInfo], name: &str) -> usize {
    if let Some(place) = of_baseline(name) {
        return place;
    }
    let curve_of = |info: &'_ PredictorInfo| match &info.sampling {
        Some(sampling) => sampling.curve.clone(),
        None => info.name.clone(),
    };
    let found = predictors.iter().find(|info| info.name == name);
    let curve = found.map_or_else(|| name.to_owned(), curve_of);
    let models = predictors.iter().filter(|info| of_baseline(&info.name).is_none());
    let mut curves: Vec<String> = Vec::new();
    for other in models.map(curve_of) {
        if !curves.contains(&other) {
            curves.push(other);
        }
    }
    let places = places(&curves);
    let place = curves.iter().zip(places).find(|(other, _)| **other == curve);
    figures::compared(place.map_or_else(|| preferred(&curve), |(_, place)| place))
}

/// The place of each model among the colours. The first of an architecture has the architecture's.
fn places(curves: &[String]) -> Vec<usize> {
    let mut places: Vec<Option<usize>> = vec![None; curves.len()];
    for (k, curve) in curves.iter().enumerate() {
        let preferred = preferred(curve);
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

/// The place of a model when no other has taken it. Those of the usual models are of colours that
/// the usual baselines do not have.
fn preferred(name: &str) -> usize {
    const ARCHITECTURES: [&str; COMPARED.len()] = [
        "lagrangian",
        "flow",
        "robomorph",
        "cdt",
        "diffuser",
        "gru",
        "prefix-transformer",
        "cdcnn",
        "",
    ];
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
    let named: Result<Baseline, Error> = Baseline::deserialize(name.into_deserializer());
    // Baselines come from the back, and in another round than models: where a model has the same
    // colour, the marker differs. There are fewer colours than baselines, and those that share one
    // have markers of their own.
    let (place, round) = match named.ok()? {
        Baseline::DampedIntegrator => (0, 1),
        Baseline::FollowReference => (0, 2),
        Baseline::BaseParameters => (0, 3),
        Baseline::HoldLast => (1, 1),
        Baseline::ConstantVelocity => (2, 1),
        Baseline::Arx => (3, 1),
        Baseline::Identification => (4, 1),
        Baseline::NominalSimulator => (5, 1),
        Baseline::SimulatorFittedDamping => (6, 1),
        Baseline::JointEkf => (6, 2),
        Baseline::LeastSquares => (7, 1),
        Baseline::FittedDamping => (8, 1),
        Baseline::Oracle => return Some(figures::MEASURED),
    };
    Some(figures::compared(round * COMPARED.len() + COMPARED.len() - 1 - place))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use spec::Given;
    use wire::PredictorKind;

    use super::*;
    use crate::report::tests::named;

    /// The colour alone, without its marker.
    fn hue(place: usize) -> usize {
        place % (COMPARED.len() + 1)
    }

    #[test]
    fn a_predictor_has_its_colour_whatever_stands_beside_it() {
        let models = ["cdt", "lagrangian"].map(|name| named(name, PredictorKind::Checkpoint));
        let held = named("hold-last", PredictorKind::Baseline);
        let few = [held.clone(), models[1].clone()];
        let all = [models[0].clone(), held, models[1].clone()];
        for name in ["hold-last", "lagrangian"] {
            assert_eq!(colour_of(&few, name), colour_of(&all, name), "{name}");
        }
        assert_ne!(colour_of(&all, "cdt"), colour_of(&all, "lagrangian"));
    }

    /// The lagrangian and least squares were both orange squares.
    #[test]
    fn no_two_predictors_look_the_same() {
        let names = ["lagrangian 1f", "lagrangian 2a", "mine", "robomorph", "least-squares", "gru"];
        let kind = |name: &str| match of_baseline(name) {
            Some(_) => PredictorKind::Baseline,
            None => PredictorKind::Checkpoint,
        };
        let all: Vec<PredictorInfo> = names.iter().map(|name| named(name, kind(name))).collect();
        let places: BTreeSet<usize> = names.iter().map(|name| colour_of(&all, name)).collect();
        assert_eq!(places.len(), names.len());
        // The models of the quickstart and its baselines have nine colours.
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
        let hues: BTreeSet<usize> = usual.iter().map(|name| hue(colour_of(&[], name))).collect();
        assert_eq!(hues.len(), usual.len());
    }

    #[test]
    fn models_beyond_the_colours_have_other_markers() {
        let names: Vec<String> = (0..30).map(|k| format!("lagrangian {k}")).collect();
        let all: Vec<PredictorInfo> =
            names.iter().map(|name| named(name, PredictorKind::Checkpoint)).collect();
        let places: BTreeSet<usize> = names.iter().map(|name| colour_of(&all, name)).collect();
        assert_eq!(places.len(), names.len());
    }

    #[test]
    fn the_usual_baselines_have_different_colours() {
        for given in [Given::Torques, Given::References] {
            let mut baselines = Baseline::usual_with(given);
            baselines.push(Baseline::Oracle);
            let count = baselines.len();
            let name = |baseline: Baseline| {
                let json = serde_json::to_value(baseline).unwrap();
                json.as_str().unwrap().to_owned()
            };
            let colours = baselines.into_iter().map(|baseline| of_baseline(&name(baseline)));
            let colours: BTreeSet<usize> = colours.map(|place| hue(place.unwrap())).collect();
            assert_eq!(colours.len(), count);
        }
    }
}

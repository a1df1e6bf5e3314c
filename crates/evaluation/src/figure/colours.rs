//! The colour of each predictor of an evaluation, that which it has in every figure.

use wire::PredictorInfo;

/// The place in the palette of a curve of `name`, which is a predictor's or that of several that
/// differ only in the sampler's steps.
pub fn colour_of(predictors: &[PredictorInfo], name: &str) -> usize {
    let curve_of = |info: &'_ PredictorInfo| match &info.sampling {
        Some(sampling) => sampling.curve.clone(),
        None => info.name.clone(),
    };
    let found = predictors.iter().find(|info| info.name == name);
    let curve = found.map_or_else(|| name.to_owned(), curve_of);
    let curves: Vec<String> = predictors.iter().map(curve_of).collect();
    let curves: Vec<&str> = curves.iter().map(String::as_str).collect();
    figures::predictor_colour(&curve, &curves)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use spec::{Baseline, ControlBaseline, Given, SamplerKind, Start};
    use wire::{PredictorKind, SamplingInfo};

    use super::*;
    use crate::report::tests::named;

    fn name(baseline: Baseline) -> String {
        let json = serde_json::to_value(baseline).unwrap();
        json.as_str().unwrap().to_owned()
    }

    #[test]
    fn predictors_that_differ_in_steps_have_the_colour_of_their_curve() {
        let sampled = |steps: u32| PredictorInfo {
            sampling: Some(SamplingInfo {
                curve: "diffuser".to_owned(),
                kind: SamplerKind::Ddim,
                steps,
                start: Start::Cold,
            }),
            ..named(&format!("diffuser ddim {steps}"), PredictorKind::Checkpoint)
        };
        let all = [named("arx", PredictorKind::Baseline), sampled(2), sampled(10)];
        let colours = ["diffuser ddim 2", "diffuser ddim 10", "diffuser"].map(|name| {
            let colour = colour_of(&all, name);
            assert_eq!(colour, figures::predictor_colour("diffuser", &[]));
            colour
        });
        assert!(!colours.contains(&colour_of(&all, "arx")));
    }

    /// `figures` knows baselines by their names alone.
    #[test]
    fn every_baseline_has_a_colour_of_its_own_in_figures() {
        let mut known: Vec<String> =
            Baseline::answering(Given::Torques).into_iter().map(name).collect();
        known.extend(Baseline::answering(Given::References).into_iter().map(name));
        known.push(name(Baseline::Oracle));
        known.extend(ControlBaseline::all().iter().map(|it| it.as_str().to_owned()));
        for name in known {
            assert!(figures::is_baseline(&name), "{name} has no place in figures' predictors.rs");
        }
    }

    #[test]
    fn the_usual_baselines_have_different_colours() {
        for given in [Given::Torques, Given::References] {
            let mut baselines = Baseline::usual_with(given);
            baselines.push(Baseline::Oracle);
            let count = baselines.len();
            let hue = |baseline: Baseline| colour_of(&[], &name(baseline)) % 10;
            let hues: BTreeSet<usize> = baselines.into_iter().map(hue).collect();
            assert_eq!(hues.len(), count);
        }
    }
}

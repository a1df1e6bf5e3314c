//! The colour of each predictor, the same in all figures.

use figures::COMPARED;
use serde::Deserialize;
use serde::de::IntoDeserializer;
use serde::de::value::Error;
use spec::Baseline;
use wire::{PredictorInfo, PredictorKind};

/// The place in the palette of a curve of `name`. Models take colours from the front, and baselines from the back. Models have that of their place among the models of `predictors`; each
/// baseline has its own, whatever else is there.
pub fn colour_of(predictors: &[PredictorInfo], name: &str) -> usize {
    if let Some(place) = of_baseline(name) {
        return place;
    }
    let models = predictors.iter().filter(|info| info.kind != PredictorKind::Baseline);
    let of_curve = |info: &PredictorInfo| {
        info.name == name || info.sampling.as_ref().is_some_and(|sampling| sampling.curve == name)
    };
    let place = models.map(of_curve).position(|is_it| is_it).unwrap_or_default();
    COMPARED[place % COMPARED.len()]
}

/// `None` unless `name` is a baseline's.
fn of_baseline(name: &str) -> Option<usize> {
    let named: Result<Baseline, Error> = Baseline::deserialize(name.into_deserializer());
    // There are fewer colours than baselines. Those that share one rarely stand beside each other: one
    // of them is not among the usual ones.
    let place = match named.ok()? {
        Baseline::DampedIntegrator | Baseline::FollowReference | Baseline::BaseParameters => 0,
        Baseline::HoldLast => 1,
        Baseline::ConstantVelocity => 2,
        Baseline::Arx => 3,
        Baseline::Identification => 4,
        Baseline::NominalSimulator => 5,
        Baseline::SimulatorFittedDamping | Baseline::JointEkf => 6,
        Baseline::LeastSquares => 7,
        Baseline::FittedDamping => 8,
        Baseline::Oracle => return Some(figures::MEASURED),
    };
    Some(COMPARED[COMPARED.len() - 1 - place])
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use spec::Given;

    use super::*;
    use crate::report::tests::named;

    #[test]
    fn a_baseline_has_its_colour_everywhere_and_models_begin_at_the_other_end() {
        let models = ["cdt", "lagrangian"].map(|name| named(name, PredictorKind::Checkpoint));
        let held = named("hold-last", PredictorKind::Baseline);
        let few = [held.clone(), models[1].clone()];
        let all = [models[0].clone(), held, models[1].clone()];
        assert_eq!(colour_of(&few, "hold-last"), colour_of(&all, "hold-last"));
        assert_eq!([colour_of(&all, "cdt"), colour_of(&all, "lagrangian")], [0, 1]);
        assert_eq!(colour_of(&few, "lagrangian"), 0);
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
            let colours: BTreeSet<usize> = colours.map(Option::unwrap).collect();
            assert_eq!(colours.len(), count);
        }
    }
}

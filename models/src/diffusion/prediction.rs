//! The three things that a model can be trained to predict, and the ways between them. All are
//! linear in the noisy series x, the clean x0 and the noise ε, with a = √ᾱ and s = √(1 - ᾱ):
//! x = a x0 + s ε and v = a ε - s x0.

use spec::Prediction;

/// Weights of two series in a third.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Mix {
    pub first: f64,
    pub second: f64,
}

/// All of the clean series and no noise.
pub(crate) const CLEAN: Mix = Mix { first: 1.0, second: 0.0 };

/// The noisy series from the clean one (first) and the noise (second).
pub(crate) fn noisy(signal: f64) -> Mix {
    Mix { first: signal.sqrt(), second: (1.0 - signal).sqrt() }
}

/// What the model is to answer, from the clean series (first) and the noise (second).
pub(crate) fn target(prediction: Prediction, signal: f64) -> Mix {
    match prediction {
        Prediction::Noise => Mix { first: 0.0, second: 1.0 },
        Prediction::Clean => Mix { first: 1.0, second: 0.0 },
        Prediction::Velocity => Mix { first: -(1.0 - signal).sqrt(), second: signal.sqrt() },
    }
}

/// The clean series from the noisy one (first) and the model's answer (second).
pub(crate) fn clean(prediction: Prediction, signal: f64) -> Mix {
    match prediction {
        Prediction::Noise => {
            Mix { first: signal.sqrt().recip(), second: -((1.0 - signal) / signal).sqrt() }
        }
        Prediction::Clean => Mix { first: 0.0, second: 1.0 },
        Prediction::Velocity => Mix { first: signal.sqrt(), second: -(1.0 - signal).sqrt() },
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use spec::Prediction;

    use super::{Mix, clean, noisy, target};

    fn mix(Mix { first, second }: Mix, a: f64, b: f64) -> f64 {
        first * a + second * b
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

        #[test]
        fn the_right_answer_gives_the_clean_series_back(
            signal in 1e-4..0.9999, x0 in -5.0..5.0, noise in -5.0..5.0
        ) {
            let x = mix(noisy(signal), x0, noise);
            for prediction in [Prediction::Noise, Prediction::Clean, Prediction::Velocity] {
                let answer = mix(target(prediction, signal), x0, noise);
                let found = mix(clean(prediction, signal), x, answer);
                prop_assert!((found - x0).abs() < 1e-9, "{prediction:?}: {found} for {x0}");
            }
        }
    }
}

//! The three quantities that a model can predict, and the conversions between them. All are linear
//! in the noisy series x, the clean x0 and the noise ε, with a = √ᾱ and s = √(1 - ᾱ): x = a x0 + s
//! ε and v = a ε - s x0.

use spec::Prediction;

/// Weights of two series in a third.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Mix {
    pub first: f64,
    pub second: f64,
}

/// The clean series without noise.
pub(crate) const CLEAN: Mix = Mix { first: 1.0, second: 0.0 };

/// The weights of the clean series (first) and the noise (second) in the noisy series.
pub(crate) fn noisy(signal: f64) -> Mix {
    Mix { first: signal.sqrt(), second: (1.0 - signal).sqrt() }
}

/// The weights of the clean series (first) and the noise (second) in the model's target.
pub(crate) fn target(prediction: Prediction, signal: f64) -> Mix {
    match prediction {
        Prediction::Noise => Mix { first: 0.0, second: 1.0 },
        Prediction::Clean => Mix { first: 1.0, second: 0.0 },
        Prediction::Velocity => Mix { first: -(1.0 - signal).sqrt(), second: signal.sqrt() },
    }
}

/// The weights of the noisy series (first) and the model's answer (second) in the clean series.
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

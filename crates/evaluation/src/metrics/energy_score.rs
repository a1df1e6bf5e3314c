//! The energy score.

/// Energy score of samples of a whole series, in the unit of its entries. It is the fair estimator
///
/// mean ‖x_i - y‖ - Σ_i Σ_j ‖x_i - x_j‖ / (2 K (K - 1))
///
/// (Gneiting and Raftery 2007, "Strictly proper scoring rules, prediction, and estimation",
/// equation 22, with the divisor of Ferro 2014). ‖·‖ is the root of the *mean* square of the
/// entries, so that series of different lengths compare. For one entry it is the CRPS. Unlike the
/// CRPS of each entry, it depends on how entries vary together. `None` below two samples.
///
/// # Panics
/// If a sample differs in length from `truth`.
pub fn energy_score(samples: &[&[f32]], truth: &[f32]) -> Option<f64> {
    if samples.len() < 2 {
        return None;
    }
    let count = samples.len() as f64;
    let distance: f64 = samples.iter().map(|sample| root_mean_square(sample, truth)).sum();
    let mut spread = 0.0;
    for (k, sample) in samples.iter().enumerate() {
        spread += samples[..k].iter().map(|other| root_mean_square(sample, other)).sum::<f64>();
    }
    Some(distance / count - spread / (count * (count - 1.0)))
}

fn root_mean_square(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len(), "series of equal length");
    let squares: f64 = a.iter().zip(b).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum();
    (squares / a.len() as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::metrics::crps;
    use crate::metrics::normal::samples;

    proptest! {
        #[test]
        fn of_one_entry_it_is_the_crps(
            samples in proptest::collection::vec(-5.0..5.0f32, 2..30), truth in -6.0..6.0f32,
        ) {
            let series: Vec<&[f32]> = samples.iter().map(std::slice::from_ref).collect();
            let mut numbers: Vec<f64> = samples.iter().map(|x| f64::from(*x)).collect();
            let expected = crps(&mut numbers, f64::from(truth)).unwrap();
            prop_assert!((energy_score(&series, &[truth]).unwrap() - expected).abs() < 1e-9);
        }

        #[test]
        fn the_order_of_samples_does_not_matter(
            mut samples in proptest::collection::vec([-5.0..5.0f32, -5.0..5.0, -5.0..5.0], 2..10),
        ) {
            let score = |samples: &[[f32; 3]]| {
                let series: Vec<&[f32]> = samples.iter().map(<[f32; 3]>::as_slice).collect();
                energy_score(&series, &[0.5, -0.5, 1.0]).unwrap()
            };
            let before = score(&samples);
            samples.reverse();
            prop_assert!((before - score(&samples)).abs() < 1e-9);
        }
    }

    /// The CRPS of each entry is the same in both cases.
    #[test]
    fn entries_that_vary_together_are_rewarded_for_saying_so() {
        #[expect(clippy::cast_possible_truncation, reason = "samples in f32")]
        let normal = |key| -> Vec<f32> { samples(key, 2000).iter().map(|x| *x as f32).collect() };
        let (common, apart) = (normal(1), [normal(2), normal(3)]);
        let truths = normal(4);
        let together: Vec<[f32; 2]> = common.iter().map(|x| [*x, *x]).collect();
        let independent: Vec<[f32; 2]> =
            apart[0].iter().zip(&apart[1]).map(|(x, y)| [*x, *y]).collect();
        let mean_score = |samples: &[[f32; 2]]| {
            let scores = truths.iter().enumerate().step_by(10).map(|(k, truth)| {
                let first = (k * 7) % 1900;
                let series: Vec<&[f32]> =
                    samples[first..first + 50].iter().map(<[f32; 2]>::as_slice).collect();
                energy_score(&series, &[*truth, *truth]).unwrap()
            });
            scores.sum::<f64>() / 200.0
        };
        let (right, wrong) = (mean_score(&together), mean_score(&independent));
        assert!(right < 0.97 * wrong, "{right} {wrong}");
    }
}

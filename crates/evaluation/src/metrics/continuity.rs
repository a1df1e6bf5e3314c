//! Jumps of the error from sample to sample.

/// How smoothly one joint's prediction continues from the last measured position and from sample to
/// sample, in degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Continuity {
    /// Absolute error of the first sample.
    pub first_sample_deg: f64,
    /// Root mean square of the change of the error from one sample to the next, without seams.
    pub jump_deg: f64,
    /// The largest change of the error from one sample to the next, with seams.
    pub largest_jump_deg: f64,
    /// Root mean square of that change over the seams; `None` without seams.
    pub seam_jump_deg: Option<f64>,
}

/// The [`Continuity`] of one joint. `truth` and `predicted` are its positions over the horizon in
/// degrees.
///
/// The change of the *error* counts, not that of the prediction, so that the arm's own motion is no
/// jump. A model that predicts `patch` samples at a time has a seam at the beginning of every patch
/// but the first.
pub fn continuity(truth: &[f64], predicted: &[f64], patch: Option<usize>) -> Continuity {
    let errors: Vec<f64> = predicted.iter().zip(truth).map(|(p, q)| p - q).collect();
    let is_seam = |sample: usize| patch.is_some_and(|patch| sample.is_multiple_of(patch));
    let (mut within, mut seams) = (MeanSquare::default(), MeanSquare::default());
    let mut largest_jump_deg = 0.0_f64;
    for (before, pair) in errors.windows(2).enumerate() {
        let jump = (pair[1] - pair[0]).abs();
        largest_jump_deg = largest_jump_deg.max(jump);
        let mean = if is_seam(before + 1) { &mut seams } else { &mut within };
        mean.add(jump);
    }
    Continuity {
        first_sample_deg: errors.first().copied().unwrap_or(0.0).abs(),
        jump_deg: within.root().unwrap_or(0.0),
        largest_jump_deg,
        seam_jump_deg: seams.root(),
    }
}

#[derive(Default)]
struct MeanSquare {
    sum: f64,
    count: u32,
}

impl MeanSquare {
    fn add(&mut self, value: f64) {
        self.sum += value * value;
        self.count += 1;
    }

    /// The root mean square; `None` without values.
    fn root(&self) -> Option<f64> {
        (self.count > 0).then(|| (self.sum / f64::from(self.count)).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Moves by 0.15° per sample.
    fn truth() -> Vec<f64> {
        (0..12).map(|k| 0.15 * f64::from(k)).collect()
    }

    #[test]
    fn a_step_at_every_patch_is_a_seam_and_nothing_within() {
        let predicted: Vec<f64> =
            truth().iter().enumerate().map(|(k, q)| q + [0.2, 0.6, 0.1][k / 4]).collect();
        let found = continuity(&truth(), &predicted, Some(4));
        assert!((found.first_sample_deg - 0.2).abs() < 1e-12);
        assert!(found.jump_deg < 1e-12, "{found:?}");
        let seams = ((0.4_f64.powi(2) + 0.5_f64.powi(2)) / 2.0).sqrt();
        assert!((found.seam_jump_deg.unwrap() - seams).abs() < 1e-12, "{found:?}");
        assert!((found.largest_jump_deg - 0.5).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn without_patches_every_change_counts_and_the_arms_own_motion_does_not() {
        let found = continuity(&truth(), &truth(), None);
        assert!(found.largest_jump_deg < 1e-12 && found.seam_jump_deg.is_none(), "{found:?}");
        let mut predicted = truth();
        predicted[5] += 1.1;
        let found = continuity(&truth(), &predicted, None);
        // The error steps up at one of eleven changes and down at the next.
        assert!((found.jump_deg - 1.1 * (2.0_f64 / 11.0).sqrt()).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn a_patch_as_long_as_the_horizon_has_no_seam() {
        assert_eq!(continuity(&truth(), &truth(), Some(12)).seam_jump_deg, None);
        assert_eq!(continuity(&truth()[..1], &truth()[..1], None).largest_jump_deg, 0.0);
    }
}

use spec::EarlyStopSpec;

/// The best result of a training's validations so far, for early stopping.
///
/// It depends only on the values, in order. A training that resumes replays the recorded values and
/// goes on as if it had never stopped.
#[derive(Clone, Debug)]
pub(super) struct Improvement {
    early_stop: Option<EarlyStopSpec>,
    /// The lowest value, and the step at which it came.
    best: Option<(u64, f64)>,
    /// The value to beat: the lowest, except for improvements that are too small to count.
    to_beat: f64,
    /// Number of validations since then.
    without: u32,
}

impl Improvement {
    pub fn new(early_stop: Option<EarlyStopSpec>) -> Self {
        Self { early_stop, best: None, to_beat: f64::INFINITY, without: 0 }
    }

    /// Adds the validation after `step` steps. Returns whether it is the best so far.
    pub fn observe(&mut self, step: u64, value: f64) -> bool {
        let min_delta = self.early_stop.map_or(0.0, |spec| spec.min_delta);
        // A comparison with NaN is false.
        if value < self.to_beat - min_delta {
            self.to_beat = value;
            self.without = 0;
        } else {
            self.without += 1;
        }
        let is_best = value.is_finite() && self.best.is_none_or(|(_, best)| value < best);
        if is_best {
            self.best = Some((step, value));
        }
        is_best
    }

    pub fn best(&self) -> Option<(u64, f64)> {
        self.best
    }

    /// The number of validations without improvement, if it ends the training.
    pub fn has_ended(&self) -> Option<u32> {
        let patience = self.early_stop?.patience;
        (self.without >= patience).then_some(self.without)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(patience: u32, min_delta: f64, values: &[f64]) -> Improvement {
        let mut improvement = Improvement::new(Some(EarlyStopSpec { patience, min_delta }));
        for (step, value) in (1..).zip(values) {
            improvement.observe(step, *value);
        }
        improvement
    }

    #[test]
    fn a_training_ends_after_as_many_validations_without_improvement_as_its_patience() {
        assert_eq!(after(2, 0.0, &[3.0, 2.0, 2.5]).has_ended(), None);
        assert_eq!(after(2, 0.0, &[3.0, 2.0, 2.5, 2.0]).has_ended(), Some(2));
        assert_eq!(after(2, 0.0, &[3.0, 2.0, 2.5, 1.9]).has_ended(), None);
        assert_eq!(after(1, 0.0, &[]).has_ended(), None);
    }

    #[test]
    fn an_improvement_within_the_delta_does_not_count_but_is_the_best() {
        let improvement = after(2, 0.5, &[3.0, 2.8, 2.6]);
        assert_eq!(improvement.has_ended(), Some(2));
        assert_eq!(improvement.best(), Some((3, 2.6)));
        // Small improvements count once they add up to a large one.
        assert_eq!(after(2, 0.5, &[3.0, 2.8, 2.4]).has_ended(), None);
    }

    #[test]
    fn what_is_not_a_number_is_never_the_best_and_brings_the_end_nearer() {
        let improvement = after(2, 0.0, &[f64::NAN, f64::NAN]);
        assert_eq!((improvement.has_ended(), improvement.best()), (Some(2), None));
        assert_eq!(after(2, 0.0, &[f64::NAN, 1.0]).best(), Some((2, 1.0)));
    }

    #[test]
    fn the_first_of_equal_values_stays_the_best() {
        assert_eq!(after(9, 0.0, &[2.0, 1.0, 1.0]).best(), Some((2, 1.0)));
    }

    #[test]
    fn without_early_stop_no_number_of_validations_is_enough() {
        let mut improvement = Improvement::new(None);
        assert!((0..1000).all(|step| improvement.observe(step, 1.0) == (step == 0)));
        assert_eq!(improvement.has_ended(), None);
    }
}

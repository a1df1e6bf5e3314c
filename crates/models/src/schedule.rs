//! The learning rate of each step.

use std::f64::consts::PI;

use spec::{OptimizerSpec, TrainSpec};

/// Learning rate over the steps of a training: linear warmup, then half a cosine
/// (Loshchilov and Hutter 2017) down to a share of the peak.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Schedule {
    peak: f64,
    final_ratio: f64,
    warmup_steps: u64,
    steps: u64,
}

impl Schedule {
    pub fn new(spec: &TrainSpec) -> Self {
        let OptimizerSpec { learning_rate, final_learning_rate_ratio, warmup_steps, .. } =
            spec.optimizer;
        Self {
            peak: learning_rate,
            final_ratio: final_learning_rate_ratio,
            warmup_steps,
            steps: spec.steps,
        }
    }

    /// Learning rate of the step that follows `done` steps. The last warmup step has the peak.
    pub fn learning_rate(&self, done: u64) -> f64 {
        if done < self.warmup_steps {
            return self.peak * (done + 1) as f64 / self.warmup_steps as f64;
        }
        let decay_steps = self.steps.saturating_sub(self.warmup_steps).max(1);
        let progress = ((done - self.warmup_steps) as f64 / decay_steps as f64).min(1.0);
        let cosine = 0.5 * (1.0 + (PI * progress).cos());
        self.peak * (self.final_ratio + (1.0 - self.final_ratio) * cosine)
    }
}

#[cfg(test)]
mod tests {
    use super::Schedule;

    const SCHEDULE: Schedule =
        Schedule { peak: 2.0, final_ratio: 0.1, warmup_steps: 10, steps: 110 };

    #[test]
    fn warmup_is_linear_and_ends_at_the_peak() {
        assert_eq!(SCHEDULE.learning_rate(0), 0.2);
        assert_eq!(SCHEDULE.learning_rate(4), 1.0);
        assert_eq!(SCHEDULE.learning_rate(9), 2.0);
    }

    #[test]
    fn the_cosine_falls_from_the_peak_to_the_final_ratio() {
        assert_eq!(SCHEDULE.learning_rate(10), 2.0);
        assert!((SCHEDULE.learning_rate(60) - 1.1).abs() < 1e-12);
        assert!((SCHEDULE.learning_rate(110) - 0.2).abs() < 1e-12);
        assert!((SCHEDULE.learning_rate(1_000) - 0.2).abs() < 1e-12);
    }

    #[test]
    fn a_training_shorter_than_its_warmup_never_divides_by_zero() {
        let short = Schedule { steps: 5, ..SCHEDULE };
        assert!((0..20).all(|step| short.learning_rate(step).is_finite()));
    }
}

//! The share of signal at each noise level of a diffusion.

use std::f64::consts::FRAC_PI_2;

use spec::DiffusionSpec;

/// Offset of the cosine, which keeps the first β from vanishing (Nichol and Dhariwal 2021).
const COSINE_OFFSET: f64 = 0.008;
const LARGEST_BETA: f64 = 0.999;

/// First and last β of the linear schedule at 1000 levels (Ho et al. 2020).
const LINEAR_BETAS: [f64; 2] = [1e-4, 0.02];
const LINEAR_LEVELS: f64 = 1000.0;

/// The signal's share of the variance at each level.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct NoiseSchedule {
    /// ᾱ, in falling order.
    signal: Vec<f64>,
}

impl NoiseSchedule {
    pub fn new(spec: &DiffusionSpec) -> Self {
        let levels = spec.steps as usize;
        let share = |level: usize| level as f64 / levels as f64;
        let cosine = |level: usize| {
            let angle = (share(level) + COSINE_OFFSET) / (1.0 + COSINE_OFFSET) * FRAC_PI_2;
            angle.cos().powi(2)
        };
        let beta = |level: usize| match spec.schedule {
            spec::NoiseSchedule::Cosine => {
                (1.0 - cosine(level + 1) / cosine(level)).min(LARGEST_BETA)
            }
            spec::NoiseSchedule::Linear => {
                let scale = LINEAR_LEVELS / levels as f64;
                let [first, last] = LINEAR_BETAS;
                let progress = level as f64 / levels.saturating_sub(1).max(1) as f64;
                (scale * (first + progress * (last - first))).min(LARGEST_BETA)
            }
        };
        let signal = (0..levels).scan(1.0, |product, level| {
            *product *= 1.0 - beta(level);
            Some(*product)
        });
        Self { signal: signal.collect() }
    }

    pub fn levels(&self) -> usize {
        self.signal.len()
    }

    /// ᾱ of `level`; 1 without a level.
    pub fn signal(&self, level: Option<usize>) -> f64 {
        level.map_or(1.0, |level| self.signal[level])
    }
}

#[cfg(test)]
mod tests {
    use spec::DiffusionSpec;

    use super::NoiseSchedule;

    /// Compares the cosine schedule of 100 levels with `squaredcos_cap_v2` of diffusers.
    #[test]
    fn the_cosine_has_the_published_values() {
        let schedule = NoiseSchedule::new(&DiffusionSpec::default());
        for (level, signal) in [(4, 0.992), (9, 0.972), (19, 0.899), (49, 0.494)] {
            let found = schedule.signal(Some(level));
            assert!((found - signal).abs() < 6e-4, "{level}: {found}");
        }
        let beta = 1.0 - schedule.signal(Some(99)) / schedule.signal(Some(98));
        assert!((beta - 0.999).abs() < 1e-12, "{beta}");
    }

    /// Ho et al. 2020: at 1000 levels ᾱ ends at 4.04e-5.
    #[test]
    fn the_line_has_the_published_end_and_keeps_it_at_fewer_levels() {
        let spec = |steps| DiffusionSpec {
            steps,
            schedule: spec::NoiseSchedule::Linear,
            ..DiffusionSpec::default()
        };
        let thousand = NoiseSchedule::new(&spec(1000)).signal(Some(999));
        assert!((thousand - 4.036e-5).abs() < 1e-8, "{thousand}");
        let hundred = NoiseSchedule::new(&spec(100)).signal(Some(99));
        assert!((hundred / thousand).ln().abs() < 1.2, "{hundred}");
    }

    #[test]
    fn signal_falls_from_level_to_level() {
        for steps in [1, 2, 20, 1000] {
            for schedule in [spec::NoiseSchedule::Cosine, spec::NoiseSchedule::Linear] {
                let spec = DiffusionSpec { steps, schedule, ..DiffusionSpec::default() };
                let schedule = NoiseSchedule::new(&spec);
                let mut before = 1.0;
                for level in 0..schedule.levels() {
                    let signal = schedule.signal(Some(level));
                    assert!(0.0 < signal && signal < before, "{spec:?}, level {level}: {signal}");
                    before = signal;
                }
            }
        }
    }
}

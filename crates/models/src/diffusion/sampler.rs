//! Samplers as tables. Each step has its weights in f64, which are known before the first pass of a
//! model.

use spec::{SamplerKind, SamplerSpec, Spacing};

use super::noise_schedule::NoiseSchedule;

/// Least variance of the noise that DDPM adds, as in the code of Ho et al. 2020.
const LEAST_VARIANCE: f64 = 1e-20;

/// One pass of the model at `level`. After it the series is `noisy · x + clean · x0 +
/// previous_clean · x0 of the step before + noise · ε`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Step {
    pub level: usize,
    pub noisy: f64,
    pub clean: f64,
    /// 0 in the first step.
    pub previous_clean: f64,
    /// Standard deviation; 0 in the last step.
    pub noise: f64,
}

/// The steps of `sampler` from noise to the clean series. With `warm` they are that many last
/// levels of the training, one by one, whatever the sampler's own steps and spacing are.
pub(crate) fn steps(
    schedule: &NoiseSchedule,
    sampler: &SamplerSpec,
    warm: Option<usize>,
) -> Vec<Step> {
    let levels = match warm {
        Some(count) => (0..count.min(schedule.levels())).rev().collect(),
        None => {
            let levels = schedule.levels();
            visited(levels, sampler.steps.map_or(levels, |steps| steps as usize), sampler.spacing)
        }
    };
    let mut steps = Vec::with_capacity(levels.len());
    for (index, &level) in levels.iter().enumerate() {
        let next = levels.get(index + 1).copied();
        let before = index.checked_sub(1).map(|before| levels[before]);
        steps.push(step(schedule, sampler, before, level, next));
    }
    steps
}

/// `count` of the levels, noisiest first.
pub(super) fn visited(levels: usize, count: usize, spacing: Spacing) -> Vec<usize> {
    let count = count.clamp(1, levels.max(1));
    // Rounds to the nearest whole number, halves upwards.
    let rounded =
        |numerator: usize, denominator: usize| (2 * numerator + denominator) / (2 * denominator);
    let level = |index: usize| {
        let left = count - 1 - index;
        match spacing {
            Spacing::Trailing => rounded(levels * (left + 1), count) - 1,
            Spacing::Leading => levels / count * left,
            Spacing::Linspace if count == 1 => levels - 1,
            Spacing::Linspace => rounded((levels - 1) * left, count - 1),
        }
    };
    (0..count).map(level).collect()
}

fn step(
    schedule: &NoiseSchedule,
    sampler: &SamplerSpec,
    before: Option<usize>,
    level: usize,
    next: Option<usize>,
) -> Step {
    // ᾱ of this level and of the one that the step leads to.
    let (signal, next_signal) = (schedule.signal(Some(level)), schedule.signal(next));
    let step = Step { level, noisy: 0.0, clean: 1.0, previous_clean: 0.0, noise: 0.0 };
    if next.is_none() {
        // All samplers end with the predicted clean series. The general formulas give the same,
        // except for DDPM's least variance and the infinite step of DPM-Solver++.
        return step;
    }
    // α and β of the step, as if the training had it.
    let kept = signal / next_signal;
    let ddpm_variance = (1.0 - next_signal) / (1.0 - signal) * (1.0 - kept);
    match sampler.kind {
        SamplerKind::Ddpm => Step {
            noisy: kept.sqrt() * (1.0 - next_signal) / (1.0 - signal),
            clean: next_signal.sqrt() * (1.0 - kept) / (1.0 - signal),
            noise: ddpm_variance.max(LEAST_VARIANCE).sqrt(),
            ..step
        },
        SamplerKind::Ddim => {
            let noise = sampler.eta * ddpm_variance.sqrt();
            let noisy = ((1.0 - next_signal - noise * noise).max(0.0) / (1.0 - signal)).sqrt();
            Step { noisy, clean: next_signal.sqrt() - noisy * signal.sqrt(), noise, ..step }
        }
        SamplerKind::DpmSolver => {
            // λ, half the logarithm of the ratio of signal to noise.
            let lambda = |signal: f64| 0.5 * (signal / (1.0 - signal)).ln();
            let length = lambda(next_signal) - lambda(signal);
            let clean = -next_signal.sqrt() * (-length).exp_m1();
            let extrapolated = before.map_or(0.0, |before| {
                let length_before = lambda(signal) - lambda(schedule.signal(Some(before)));
                0.5 * length / length_before
            });
            Step {
                noisy: ((1.0 - next_signal) / (1.0 - signal)).sqrt(),
                clean: clean * (1.0 + extrapolated),
                previous_clean: -clean * extrapolated,
                ..step
            }
        }
        // The check of the spec refuses these for a diffusion.
        SamplerKind::Euler | SamplerKind::Heun => step,
    }
}

#[cfg(test)]
mod tests {
    use spec::{DiffusionSpec, SamplerKind, SamplerSpec, Spacing};

    use super::{steps, visited};
    use crate::diffusion::noise_schedule::NoiseSchedule;

    #[test]
    fn spacings_visit_the_levels_they_state() {
        assert_eq!(visited(100, 5, Spacing::Trailing), [99, 79, 59, 39, 19]);
        assert_eq!(visited(100, 5, Spacing::Leading), [80, 60, 40, 20, 0]);
        assert_eq!(visited(100, 5, Spacing::Linspace), [99, 74, 50, 25, 0]);
        assert_eq!(visited(10, 4, Spacing::Trailing), [9, 7, 4, 2]);
        assert_eq!(visited(10, 1, Spacing::Linspace), [9]);
    }

    #[test]
    fn as_many_steps_as_levels_visit_every_level_once() {
        for spacing in [Spacing::Trailing, Spacing::Leading, Spacing::Linspace] {
            for count in [1, 2, 7, 100] {
                let all: Vec<usize> = (0..count).rev().collect();
                assert_eq!(visited(count, count, spacing), all);
            }
        }
    }

    #[test]
    fn no_level_is_visited_twice() {
        for spacing in [Spacing::Trailing, Spacing::Leading, Spacing::Linspace] {
            for count in 1..=37 {
                let levels = visited(37, count, spacing);
                assert!(levels.windows(2).all(|pair| pair[0] > pair[1]), "{spacing:?} {levels:?}");
                assert_eq!(levels.len(), count);
            }
        }
    }

    #[test]
    fn ddim_with_all_of_the_noise_is_ddpm() {
        let schedule = NoiseSchedule::new(&DiffusionSpec::default());
        let sampler = |kind, eta| SamplerSpec { kind, eta, ..SamplerSpec::default() };
        let ddpm = steps(&schedule, &sampler(SamplerKind::Ddpm, 0.0), None);
        let ddim = steps(&schedule, &sampler(SamplerKind::Ddim, 1.0), None);
        for (a, b) in ddpm.iter().zip(&ddim) {
            let differences = [a.noisy - b.noisy, a.clean - b.clean, a.noise - b.noise];
            assert!(differences.iter().all(|difference| difference.abs() < 1e-9), "{a:?} {b:?}");
        }
    }

    #[test]
    fn a_warm_start_runs_the_last_levels_one_by_one() {
        let schedule = NoiseSchedule::new(&DiffusionSpec::default());
        let sampler = SamplerSpec { steps: Some(10), ..SamplerSpec::default() };
        let warm = steps(&schedule, &sampler, Some(5));
        let levels: Vec<usize> = warm.iter().map(|step| step.level).collect();
        assert_eq!(levels, [4, 3, 2, 1, 0]);
        let all = steps(&schedule, &SamplerSpec::default(), None);
        assert_eq!(warm, all[95..]);
    }

    #[test]
    fn the_last_step_adds_no_noise_and_gives_the_clean_series() {
        let schedule = NoiseSchedule::new(&DiffusionSpec::default());
        for kind in [SamplerKind::Ddpm, SamplerKind::Ddim, SamplerKind::DpmSolver] {
            for count in [1, 2, 100] {
                let sampler = SamplerSpec { kind, steps: Some(count), ..SamplerSpec::default() };
                let steps = steps(&schedule, &sampler, None);
                let last = steps.last().unwrap();
                assert_eq!((last.noisy, last.clean), (0.0, 1.0));
                assert_eq!((last.previous_clean, last.noise), (0.0, 0.0));
            }
        }
    }
}

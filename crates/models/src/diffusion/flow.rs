//! Straight lines from noise to the clean series (rectified flow, Liu et al. 2022).
//!
//! Level n of 1000 is the time t = (n + 1) / 1000. The series is (1 - t) x0 + t ε and moves with
//! the velocity ε - x0. A solver goes from one time to an earlier one along a velocity, which
//! follows from the network's answer. In terms of x0, its table of coefficients is the same as for
//! diffusion.

use spec::{FLOW_LEVELS, FLOW_STEPS, FlowPrediction, FlowSpec, SamplerKind, SamplerSpec};

use super::mixing::Mix;
use super::sampler::{Step, visited};

/// A flow with the settings of its training.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Flow {
    prediction: FlowPrediction,
    /// The number of levels at which warm starts begin.
    warm_levels: usize,
}

impl Flow {
    pub fn new(spec: &FlowSpec) -> Self {
        Self { prediction: spec.prediction, warm_levels: spec.warm_levels() as usize }
    }

    pub const fn levels() -> usize {
        FLOW_LEVELS as usize
    }

    /// The weights of the clean series (first) and the noise (second) in the noisy series.
    pub fn noisy(level: usize) -> Mix {
        Mix { first: 1.0 - time(level), second: time(level) }
    }

    /// The weights of the clean series (first) and the noise (second) in the network's target.
    pub fn target(&self) -> Mix {
        match self.prediction {
            FlowPrediction::Clean => Mix { first: 1.0, second: 0.0 },
            FlowPrediction::Velocity => Mix { first: -1.0, second: 1.0 },
        }
    }

    /// The weights of the noisy series (first) and the network's answer (second) in the clean
    /// series.
    pub fn clean(&self, level: usize) -> Mix {
        match self.prediction {
            FlowPrediction::Clean => Mix { first: 0.0, second: 1.0 },
            FlowPrediction::Velocity => Mix { first: 1.0, second: -time(level) },
        }
    }

    /// The passes of `sampler` from noise to the clean series. With `warm` they are that many even
    /// steps from the level at which warm starts begin.
    pub fn steps(&self, sampler: &SamplerSpec, warm: Option<usize>) -> Vec<Step> {
        let (levels, count) = match warm {
            Some(count) => (self.warm_levels, count),
            None => (Self::levels(), sampler.steps.unwrap_or(FLOW_STEPS) as usize),
        };
        let levels = visited(levels, count, sampler.spacing);
        let mut steps = Vec::with_capacity(2 * levels.len());
        for (index, &level) in levels.iter().enumerate() {
            let at = Step { level, noisy: 0.0, clean: 1.0, previous_clean: 0.0, noise: 0.0 };
            let Some(&next) = levels.get(index + 1) else {
                // At time 0 a velocity has no meaning. The last step uses the velocity at its
                // beginning.
                steps.push(at);
                break;
            };
            let ratio = time(next) / time(level);
            steps.push(Step { noisy: ratio, clean: 1.0 - ratio, ..at });
            if sampler.kind == SamplerKind::Heun {
                // Euler's step becomes Heun's with the mean of both velocities. The velocities
                // differ as both x0 do, since the series of the first has moved along a line
                // through its x0.
                let half = (1.0 - ratio) / (2.0 * ratio);
                let moved = Step { noisy: 1.0, clean: half, previous_clean: -half, ..at };
                steps.push(Step { level: next, ..moved });
            }
        }
        steps
    }
}

fn time(level: usize) -> f64 {
    (level + 1) as f64 / f64::from(FLOW_LEVELS)
}

#[cfg(test)]
mod tests {
    use spec::{FlowPrediction, SamplerKind, SamplerSpec};

    use super::Flow;
    use crate::diffusion::Step;

    const FLOW: Flow = Flow { prediction: FlowPrediction::Velocity, warm_levels: 400 };

    fn table(kind: SamplerKind, steps: u32) -> Vec<Step> {
        FLOW.steps(&SamplerSpec { kind, steps: Some(steps), ..SamplerSpec::default() }, None)
    }

    fn levels(steps: &[Step]) -> Vec<usize> {
        steps.iter().map(|step| step.level).collect()
    }

    #[test]
    fn the_right_answer_gives_the_clean_series_back() {
        let (x0, noise) = (0.7, -1.3);
        for prediction in [FlowPrediction::Clean, FlowPrediction::Velocity] {
            let flow = Flow { prediction, ..FLOW };
            for level in [0, 499, 999] {
                let mix = |mix: super::Mix, a: f64, b: f64| mix.first * a + mix.second * b;
                let x = mix(Flow::noisy(level), x0, noise);
                let answer = mix(flow.target(), x0, noise);
                let found = mix(flow.clean(level), x, answer);
                assert!((found - x0).abs() < 1e-12, "{prediction:?}: {found}");
            }
        }
    }

    #[test]
    fn steps_are_even_from_noise_or_from_where_warm_starts_begin() {
        assert_eq!(levels(&table(SamplerKind::Euler, 1)), [999]);
        assert_eq!(levels(&table(SamplerKind::Euler, 4)), [999, 749, 499, 249]);
        assert_eq!(levels(&table(SamplerKind::Heun, 3)), [999, 666, 666, 332, 332]);
        let sampler = SamplerSpec { kind: SamplerKind::Euler, ..SamplerSpec::default() };
        assert_eq!(levels(&FLOW.steps(&sampler, None)), [999, 499]);
        assert_eq!(levels(&FLOW.steps(&sampler, Some(2))), [399, 199]);
    }

    /// For x0 normal with mean m and deviation d, the velocity at time t is that of x = (1 - t) m +
    /// √((1 - t)² d² + t²) z, whose solution keeps z: noise z ends at m + d z. The best guess of x0
    /// is m + (1 - t) d² (x - (1 - t) m) / ((1 - t)² d² + t²).
    fn solved(steps: &[Step], z: f64) -> f64 {
        let (mean, variance) = (0.7, 0.09);
        let (mut x, mut before) = (z, 0.0);
        for step in steps {
            let time = (step.level + 1) as f64 / 1000.0;
            let signal = 1.0 - time;
            let weight = signal * variance / (signal * signal * variance + time * time);
            let clean = mean + weight * (x - signal * mean);
            x = step.noisy * x + step.clean * clean + step.previous_clean * before;
            before = clean;
        }
        x
    }

    #[test]
    fn one_step_gives_the_mean_and_many_the_distribution() {
        for kind in [SamplerKind::Euler, SamplerKind::Heun] {
            assert!((solved(&table(kind, 1), 1.5) - 0.7).abs() < 1e-12);
            for z in [-2.0, 0.0, 1.0] {
                let (found, exact) = (solved(&table(kind, 500), z), 0.7 + 0.3 * z);
                assert!((found - exact).abs() < 0.01, "{kind:?}: {found}, exactly {exact}");
            }
        }
    }

    /// The error of a solver of order p falls by 2^p when the steps double.
    #[test]
    fn the_solvers_converge_with_their_orders() {
        let error = |kind, steps| (solved(&table(kind, steps), 1.0) - 1.0).abs();
        let falls = |kind| error(kind, 50) / error(kind, 100);
        let (first, second) = (falls(SamplerKind::Euler), falls(SamplerKind::Heun));
        assert!((1.8..2.2).contains(&first), "{first}");
        assert!((3.5..4.5).contains(&second), "{second}");
    }
}

//! Samplers on data whose best denoiser is known. For x0 normal with mean m and variance V it is
//! E[x0 | x] = m + √ᾱ V (x - √ᾱ m) / (ᾱ V + 1 - ᾱ). The series that a sampler makes is then normal
//! too, and its mean and variance follow exactly from the table of steps, without a random draw.

use spec::{DiffusionSpec, NoiseSchedule as Schedule, SamplerKind, SamplerSpec, Spacing};

use super::Step;
use super::noise_schedule::NoiseSchedule;
use super::sampler::steps;

const MEAN: f64 = 0.7;
const VARIANCE: f64 = 0.09;

/// The weight of the noisy series in the best guess of the clean one, and the constant term.
fn best_denoiser(signal: f64) -> (f64, f64) {
    let weight = signal.sqrt() * VARIANCE / (signal * VARIANCE + 1.0 - signal);
    (weight, MEAN - weight * signal.sqrt() * MEAN)
}

/// Mean and variance of the series that `steps` make from standard normal noise.
///
/// The series and the last step's x0 are jointly normal. The function follows both.
fn made(schedule: &NoiseSchedule, steps: &[Step]) -> (f64, f64) {
    // Means and covariance of x and of the x0 of the step before.
    let (mut mean, mut mean_before) = (0.0, 0.0);
    let (mut variance, mut covariance, mut variance_before) = (1.0, 0.0, 0.0);
    for step in steps {
        let (weight, constant) = best_denoiser(schedule.signal(Some(step.level)));
        let of_x = step.noisy + step.clean * weight;
        let of_before = step.previous_clean;
        let next_mean = of_x * mean + of_before * mean_before + step.clean * constant;
        let next_variance = of_x * of_x * variance
            + 2.0 * of_x * of_before * covariance
            + of_before * of_before * variance_before
            + step.noise * step.noise;
        let next_covariance = weight * (of_x * variance + of_before * covariance);
        (mean_before, variance_before) = (weight * mean + constant, weight * weight * variance);
        (mean, variance, covariance) = (next_mean, next_variance, next_covariance);
    }
    (mean, variance)
}

fn sampled(spec: &DiffusionSpec, sampler: &SamplerSpec) -> (f64, f64) {
    let schedule = NoiseSchedule::new(spec);
    made(&schedule, &steps(&schedule, sampler, None))
}

#[track_caller]
fn check(spec: &DiffusionSpec, sampler: &SamplerSpec, tolerance: f64) {
    let (mean, variance) = sampled(spec, sampler);
    let deviation = (variance / VARIANCE).sqrt();
    assert!((mean - MEAN).abs() < tolerance * VARIANCE.sqrt(), "{sampler:?}: mean {mean}");
    assert!((deviation - 1.0).abs() < tolerance, "{sampler:?}: deviation {deviation} of 1");
}

fn sampler(kind: SamplerKind, steps: Option<u32>) -> SamplerSpec {
    SamplerSpec { kind, steps, ..SamplerSpec::default() }
}

#[test]
fn with_many_steps_every_sampler_makes_the_datas_mean_and_variance() {
    let spec = DiffusionSpec { steps: 1000, ..DiffusionSpec::default() };
    check(&spec, &sampler(SamplerKind::Ddpm, None), 0.01);
    check(&spec, &sampler(SamplerKind::Ddim, None), 0.01);
    check(&spec, &SamplerSpec { eta: 0.5, ..sampler(SamplerKind::Ddim, None) }, 0.01);
    check(&spec, &sampler(SamplerKind::DpmSolver, None), 0.01);
}

#[test]
fn a_linear_schedule_leads_there_too() {
    let spec =
        DiffusionSpec { steps: 1000, schedule: Schedule::Linear, ..DiffusionSpec::default() };
    for kind in [SamplerKind::Ddpm, SamplerKind::Ddim, SamplerKind::DpmSolver] {
        check(&spec, &sampler(kind, None), 0.03);
    }
}

/// The second order is closer at few steps.
#[test]
fn at_few_steps_dpm_solver_is_closer_than_ddim() {
    let spec = DiffusionSpec { steps: 1000, ..DiffusionSpec::default() };
    let error = |kind, steps| {
        let (_, variance) = sampled(&spec, &sampler(kind, Some(steps)));
        ((variance / VARIANCE).sqrt() - 1.0).abs()
    };
    for steps in [15, 30, 60] {
        let (first, second) =
            (error(SamplerKind::Ddim, steps), error(SamplerKind::DpmSolver, steps));
        assert!(second < 0.5 * first, "{steps} steps: {second} against {first}");
    }
}

/// The error of a solver of order p falls by 2^p when the steps double.
#[test]
fn the_solvers_converge_with_their_orders() {
    let spec = DiffusionSpec { steps: 10_000, ..DiffusionSpec::default() };
    let error = |kind, steps| {
        let sampler = SamplerSpec { spacing: Spacing::Linspace, ..sampler(kind, Some(steps)) };
        let (_, variance) = sampled(&spec, &sampler);
        let (_, limit) = sampled(&spec, &SamplerSpec { steps: Some(10_000), ..sampler });
        (variance.sqrt() - limit.sqrt()).abs()
    };
    let first = error(SamplerKind::Ddim, 50) / error(SamplerKind::Ddim, 100);
    assert!((1.5..3.0).contains(&first), "{first}");
    let second = error(SamplerKind::DpmSolver, 50) / error(SamplerKind::DpmSolver, 100);
    assert!(second > 3.0, "{second}");
}

/// Compares deterministic steps with the exact solution of the probability-flow equation. For
/// normal data every point keeps its distance from the mean, in standard deviations.
#[test]
fn ddim_follows_the_probability_flow() {
    let spec = DiffusionSpec { steps: 4000, ..DiffusionSpec::default() };
    let schedule = NoiseSchedule::new(&spec);
    let table = steps(&schedule, &sampler(SamplerKind::Ddim, None), None);
    let noisiest = schedule.signal(Some(table[0].level));
    for deviations in [-2.0, -0.5, 0.0, 1.0, 3.0] {
        let spread = (noisiest * VARIANCE + 1.0 - noisiest).sqrt();
        let mut x = noisiest.sqrt() * MEAN + deviations * spread;
        for step in &table {
            let (weight, constant) = best_denoiser(schedule.signal(Some(step.level)));
            x = step.noisy * x + step.clean * (weight * x + constant);
        }
        let exact = MEAN + deviations * VARIANCE.sqrt();
        assert!((x - exact).abs() < 0.003, "{deviations}: {x}, exactly {exact}");
    }
}

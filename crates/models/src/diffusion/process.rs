//! The diffusion or flow of a model: noise that training adds, and chains that remove it.

use burn::tensor::{Device, Tensor, TensorData};
use spec::{DiffusionSpec, FlowSpec, LossMean, SamplerSpec};

use super::mixing::{CLEAN, Mix, Mixing};
use super::sampler::Step;
use crate::loss::Loss;
use crate::randomness::Noise;

/// Adds noise in training and removes it in sampling.
#[derive(Clone, Debug)]
pub(crate) struct Process {
    mixing: Mixing,
    clip: Option<f64>,
    loss_mean: LossMean,
}

/// The entries of a series that are known, with their values.
#[derive(Clone, Debug)]
pub(crate) struct Painted {
    /// `[batch, sample, channel]`; any finite value where nothing is known.
    pub values: Tensor<3>,
    /// `[1, sample, channel]`: 1 where the model sees the clean value, else 0.
    pub clean: Tensor<3>,
    /// `[1, sample, channel]`: 1 where the value is known but the model sees it with the noise of
    /// the level, else 0.
    pub noised: Option<Tensor<3>>,
}

impl Painted {
    /// Replaces the known entries of `series` by their values, noised as `noisy` says.
    fn over(&self, series: Tensor<3>, noisy: Mix, noise: &Tensor<3>) -> Tensor<3> {
        let series = blend(series, self.values.clone(), &self.clean);
        match &self.noised {
            None => series,
            Some(mask) => {
                let known = mixed(noisy, self.values.clone(), noise.clone());
                blend(series, known, mask)
            }
        }
    }
}

impl Process {
    pub fn diffusion(spec: &DiffusionSpec) -> Self {
        let DiffusionSpec { clip, loss_mean, .. } = *spec;
        Self { mixing: Mixing::diffusion(spec), clip, loss_mean }
    }

    pub fn flow(spec: &FlowSpec) -> Self {
        Self { mixing: Mixing::flow(spec), clip: None, loss_mean: LossMean::Unknown }
    }

    pub fn steps(&self, sampler: &SamplerSpec, warm: Option<usize>) -> Vec<Step> {
        self.mixing.steps(sampler, warm)
    }

    /// Weighted squared errors of the answers of `network` at a random level for each row of
    /// `series` `[batch, sample, channel]`. `clean` `[1, sample, channel]` is 1 where the model
    /// sees the clean value. `weights`, of the same shape, are 0 where errors do not count.
    pub fn loss(
        &self,
        series: &Tensor<3>,
        clean: &Tensor<3>,
        weights: Tensor<3>,
        counted: usize,
        random: &mut Noise,
        network: impl FnOnce(Tensor<3>, &[usize]) -> Tensor<3>,
    ) -> Loss {
        let [batch, samples, channels] = series.dims();
        let device = series.device();
        let levels = random.below(self.mixing.levels());
        let noise = random.normal([samples, channels], &device);
        let mix = |of: &dyn Fn(usize) -> Mix| {
            let mixes: Vec<Mix> = levels.iter().map(|&level| of(level)).collect();
            column(mixes.iter().map(|mix| mix.first), &device) * series.clone()
                + column(mixes.iter().map(|mix| mix.second), &device) * noise.clone()
        };
        let noisy = blend(mix(&|level| self.mixing.noisy(level)), series.clone(), clean);
        let target = mix(&|level| self.mixing.target(level));
        let errors = (network(noisy, &levels) - target).square() * weights;
        let of_each = match self.loss_mean {
            LossMean::Unknown => counted,
            LossMean::All => samples * channels,
        };
        Loss { errors, count: batch * of_each, predicted: None }
    }

    /// The clean series `[batch, sample, channel]` that `network` makes in `steps`. It begins with
    /// noise. A warm start begins with the guess `warm`, in the same shape, plus the noise of the
    /// first level.
    pub fn sample(
        &self,
        warm: Option<Tensor<3>>,
        painted: &Painted,
        steps: &[Step],
        random: &mut Noise,
        mut network: impl FnMut(Tensor<3>, &[usize]) -> Tensor<3>,
    ) -> Tensor<3> {
        let [batch, samples, channels] = painted.values.dims();
        let device = painted.values.device();
        let first = random.normal([samples, channels], &device);
        let noisy = |step: &Step| self.mixing.noisy(step.level);
        let mut x = match (warm, steps.first()) {
            (Some(guess), Some(step)) => mixed(noisy(step), guess, first.clone()),
            (Some(guess), None) => guess,
            (None, _) => first.clone(),
        };
        let mut clean_before: Option<Tensor<3>> = None;
        for step in steps {
            x = painted.over(x, noisy(step), &first);
            let answer = network(x.clone(), &vec![step.level; batch]);
            let mut clean = mixed(self.mixing.clean(step.level), x.clone(), answer);
            if let Some(clip) = self.clip {
                clean = clean.clamp(-clip, clip);
            }
            let mut next = mixed(Mix { first: step.noisy, second: step.clean }, x, clean.clone());
            if let (Some(before), true) = (clean_before, step.previous_clean != 0.0) {
                next = next + before.mul_scalar(step.previous_clean);
            }
            if step.noise != 0.0 {
                next = next + random.normal([samples, channels], &device).mul_scalar(step.noise);
            }
            clean_before = Some(clean);
            x = next;
        }
        painted.over(x, CLEAN, &first)
    }
}

/// `values` where `mask` is 1, `series` where it is 0.
fn blend(series: Tensor<3>, values: Tensor<3>, mask: &Tensor<3>) -> Tensor<3> {
    series * (mask.clone().neg() + 1.0) + values * mask.clone()
}

fn mixed(mix: Mix, first: Tensor<3>, second: Tensor<3>) -> Tensor<3> {
    first.mul_scalar(mix.first) + second.mul_scalar(mix.second)
}

/// One number per row, `[batch, 1, 1]`.
#[expect(clippy::cast_possible_truncation, reason = "series are computed in f32")]
fn column(values: impl Iterator<Item = f64>, device: &Device) -> Tensor<3> {
    let values: Vec<f32> = values.map(|value| value as f32).collect();
    let rows = values.len();
    Tensor::from_data(TensorData::new(values, [rows, 1, 1]), device)
}

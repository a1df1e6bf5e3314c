//! Initial weights, drawn from a seed.

use burn::module::{Param, ParamId};
use burn::tensor::{Device, Tensor, TensorData};
use random::{ChaCha12Rng, SeedableRng, unit_f32};

/// Standard deviation of initial position embeddings, as in GPT-2.
pub(crate) const POSITION_STANDARD_DEVIATION: f32 = 0.02;

/// Draws initial weights from a seed, one after the other.
///
/// burn's own initializers draw from a generator that the whole process shares. Weights must depend
/// only on the seed and on the order in which the model asks for them.
pub(crate) struct InitialWeights<'a> {
    /// `None` where weights are not drawn.
    generator: Option<ChaCha12Rng>,
    device: &'a Device,
}

impl<'a> InitialWeights<'a> {
    pub fn new(seed: u64, device: &'a Device) -> Self {
        Self { generator: Some(ChaCha12Rng::seed_from_u64(seed)), device }
    }

    /// Makes shapes without memory, for a model whose weights come from elsewhere or are not
    /// needed.
    pub fn none(device: &'a Device) -> Self {
        Self { generator: None, device }
    }

    /// Uniform on `[-bound, bound)`.
    pub fn uniform<const D: usize>(&mut self, shape: [usize; D], bound: f32) -> Param<Tensor<D>> {
        self.parameter(shape, |generator| (2.0 * unit_f32(generator) - 1.0) * bound)
    }

    /// Normal with mean 0 (Box and Muller 1958, the cosine branch).
    pub fn normal<const D: usize>(
        &mut self,
        shape: [usize; D],
        standard_deviation: f32,
    ) -> Param<Tensor<D>> {
        self.parameter(shape, |generator| {
            let radius = (-2.0 * (1.0 - unit_f32(generator)).ln()).sqrt();
            radius * (std::f32::consts::TAU * unit_f32(generator)).cos() * standard_deviation
        })
    }

    /// `count` numbers, uniform on `[-bound, bound)`, for a parameter that is made of them.
    pub fn draws(&mut self, count: usize, bound: f32) -> Vec<f32> {
        let draw = |generator: &mut ChaCha12Rng| (2.0 * unit_f32(generator) - 1.0) * bound;
        match &mut self.generator {
            Some(generator) => (0..count).map(|_| draw(generator)).collect(),
            None => vec![0.0; count],
        }
    }

    pub fn constant<const D: usize>(&mut self, shape: [usize; D], value: f32) -> Param<Tensor<D>> {
        self.parameter(shape, |_| value)
    }

    /// A parameter with these values, in row-major order.
    pub fn given<const D: usize>(
        &mut self,
        shape: [usize; D],
        values: impl IntoIterator<Item = f32>,
    ) -> Param<Tensor<D>> {
        let mut values = values.into_iter();
        self.parameter(shape, |_| values.next().unwrap_or_default())
    }

    fn parameter<const D: usize>(
        &mut self,
        shape: [usize; D],
        mut draw: impl FnMut(&mut ChaCha12Rng) -> f32,
    ) -> Param<Tensor<D>> {
        let Some(generator) = &mut self.generator else {
            let zeros = move |device: &Device, is_tracked| {
                Tensor::zeros(shape, device).set_require_grad(is_tracked)
            };
            return Param::uninitialized(
                ParamId::new(),
                zeros,
                self.device.clone(),
                true,
                shape.into(),
            );
        };
        let values: Vec<f32> = (0..shape.iter().product()).map(|_| draw(generator)).collect();
        Param::from_data(TensorData::new(values, shape), self.device)
    }
}

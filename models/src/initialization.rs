use burn::module::Param;
use burn::tensor::{Device, Tensor, TensorData};
use random::{ChaCha12Rng, SeedableRng, unit_f32};

/// Standard deviation of initial positions, GPT-2's.
pub(crate) const POSITION_STANDARD_DEVIATION: f32 = 0.02;

/// Draws initial weights, one after the other, from a seed.
///
/// burn's own initializers draw from a generator that the whole process shares; weights must
/// depend on nothing but the seed and the order in which the model asks for them.
pub(crate) struct InitialWeights<'a> {
    generator: ChaCha12Rng,
    device: &'a Device,
}

impl<'a> InitialWeights<'a> {
    pub fn new(seed: u64, device: &'a Device) -> Self {
        Self { generator: ChaCha12Rng::seed_from_u64(seed), device }
    }

    /// Uniform on `[-bound, bound)`.
    pub fn uniform<const D: usize>(&mut self, shape: [usize; D], bound: f32) -> Param<Tensor<D>> {
        let values = (0..shape.iter().product())
            .map(|_| (2.0 * unit_f32(&mut self.generator) - 1.0) * bound)
            .collect();
        self.parameter(values, shape)
    }

    /// Normal with mean 0 (Box and Muller 1958, the cosine branch).
    pub fn normal<const D: usize>(
        &mut self,
        shape: [usize; D],
        standard_deviation: f32,
    ) -> Param<Tensor<D>> {
        let values = (0..shape.iter().product())
            .map(|_| {
                let radius = (-2.0 * (1.0 - unit_f32(&mut self.generator)).ln()).sqrt();
                radius
                    * (std::f32::consts::TAU * unit_f32(&mut self.generator)).cos()
                    * standard_deviation
            })
            .collect();
        self.parameter(values, shape)
    }

    pub fn constant<const D: usize>(&self, shape: [usize; D], value: f32) -> Param<Tensor<D>> {
        self.parameter(vec![value; shape.iter().product()], shape)
    }

    fn parameter<const D: usize>(&self, values: Vec<f32>, shape: [usize; D]) -> Param<Tensor<D>> {
        Param::from_data(TensorData::new(values, shape), self.device)
    }
}

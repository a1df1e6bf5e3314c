//! Layers that several networks use.

use burn::module::{Module, Param};
use burn::tensor::Tensor;
use kernels::{DropoutKeys, DropoutMask, Factors, PackedWeight};

use crate::initialization::InitialWeights;

/// `y = x Wᵀ + b`, with parameter names, layout and initial weights of `torch.nn.Linear`.
///
/// burn's own `Linear` keeps W transposed. This one keeps PyTorch's layout, so that checkpoints
/// load into PyTorch without conversion.
#[derive(Module, Debug)]
pub(crate) struct Linear {
    /// `[output, input]`
    weight: Param<Tensor<2>>,
    /// `[output]`
    bias: Param<Tensor<1>>,
    #[module(skip)]
    packed: PackedWeight,
}

impl Linear {
    /// Weights and biases uniform on ±1/√input.
    pub fn new(input: usize, output: usize, weights: &mut InitialWeights<'_>) -> Self {
        Self::reading(Factors::F32, input, output, weights)
    }

    /// [`Linear::new`], with products that read `factors`.
    pub fn reading(
        factors: Factors,
        input: usize,
        output: usize,
        weights: &mut InitialWeights<'_>,
    ) -> Self {
        let bound = 1.0 / (input as f32).sqrt();
        Self {
            weight: weights.uniform([output, input], bound),
            bias: weights.uniform([output], bound),
            packed: PackedWeight::new(factors),
        }
    }

    /// Biases as given and weights uniform on ±`bound`, so that outputs begin near the biases.
    pub fn near(
        biases: &[f32],
        input: usize,
        bound: f32,
        weights: &mut InitialWeights<'_>,
    ) -> Self {
        Self {
            weight: weights.uniform([biases.len(), input], bound),
            bias: weights.given([biases.len()], biases.iter().copied()),
            packed: PackedWeight::default(),
        }
    }

    /// The weight `[output, input]` and the bias `[output]`.
    pub fn parameters(&self) -> (Tensor<2>, Tensor<1>) {
        (self.weight.val(), self.bias.val())
    }

    /// `[batch, token, input]` to `[batch, token, output]`.
    pub fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        kernels::linear(x, self.weight.val(), self.bias.val(), &self.packed)
    }

    /// The product with the weight alone. It maps rates of change of the input to those of the
    /// output.
    pub fn forward_without_bias(&self, x: Tensor<3>) -> Tensor<3> {
        let none = Tensor::from_inner(self.bias.val().inner().zeros_like());
        kernels::linear(x, self.weight.val(), none, &self.packed)
    }

    /// The layer after `norm`.
    pub fn forward_normed(&self, x: Tensor<3>, norm: &LayerNorm) -> Tensor<3> {
        let norm = norm.parameters();
        kernels::norm_linear(x, norm, self.weight.val(), self.bias.val(), &self.packed)
    }

    /// Three layers of the same normed `x`, with their outputs side by side. `packed` holds the
    /// weights of all three.
    pub fn forward_three_normed(
        maps: [&Self; 3],
        x: Tensor<3>,
        norm: &LayerNorm,
        packed: &PackedWeight,
    ) -> Tensor<3> {
        let (weights, biases) = (maps.map(|map| map.weight.val()), maps.map(|map| map.bias.val()));
        kernels::norm_linear_of_three(x, norm.parameters(), weights, biases, packed)
    }

    /// `residual` plus this layer of GELU of `x`. `masks` apply dropout to the output of GELU and
    /// to that of this layer.
    pub fn forward_gelu_onto(
        &self,
        residual: Tensor<3>,
        x: Tensor<3>,
        masks: [Option<DropoutMask>; 2],
    ) -> Tensor<3> {
        let (weight, bias) = (self.weight.val(), self.bias.val());
        kernels::gelu_linear_onto(residual, x, weight, bias, &self.packed, masks)
    }

    /// The widths of input and output. They are known without the weights.
    pub fn widths(&self) -> [usize; 2] {
        let [output, input] = self.weight.lazy_shape().dims();
        [input, output]
    }
}

/// Layer normalization over the last dimension (Ba et al. 2016), with the names and ε of
/// `torch.nn.LayerNorm`.
#[derive(Module, Debug)]
pub(crate) struct LayerNorm {
    /// `[width]`, initially 1.
    weight: Param<Tensor<1>>,
    /// `[width]`, initially 0.
    bias: Param<Tensor<1>>,
}

impl LayerNorm {
    pub fn new(width: usize, weights: &mut InitialWeights<'_>) -> Self {
        Self { weight: weights.constant([width], 1.0), bias: weights.constant([width], 0.0) }
    }

    /// `[batch, token, width]` to the same shape.
    pub fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        let [weight, bias] = self.parameters();
        kernels::layer_norm(x, weight, bias)
    }

    fn parameters(&self) -> [Tensor<1>; 2] {
        [self.weight.val(), self.bias.val()]
    }
}

/// `x` `[batch, token, width]` plus the learned embedding of each position, `[token, width]`.
pub(crate) fn add_positions(x: Tensor<3>, positions: &Param<Tensor<2>>) -> Tensor<3> {
    let [_, tokens, width] = x.dims();
    x + positions.val().slice([0..tokens, 0..width]).unsqueeze()
}

/// Gives each layer of a network its dropout mask, in the order of a pass.
pub(crate) struct Dropout {
    /// The keys of the trajectories; `None` outside training.
    keys: Option<DropoutKeys>,
    /// The share of values that blocks drop.
    rate: f64,
    places: u32,
}

impl Dropout {
    pub fn new(keys: Option<DropoutKeys>, rate: f64) -> Self {
        Self { keys, rate, places: 0 }
    }

    pub fn off() -> Self {
        Self::new(None, 0.0)
    }

    /// The mask of the next layer in a block.
    pub fn mask(&mut self) -> Option<DropoutMask> {
        self.mask_at(self.rate)
    }

    /// Applies dropout to `x` in the next layer of a block.
    pub fn apply(&mut self, x: Tensor<3>) -> Tensor<3> {
        self.apply_at(self.rate, x)
    }

    /// Applies dropout to `x` in the next layer, at `rate`.
    pub fn apply_at(&mut self, rate: f64, x: Tensor<3>) -> Tensor<3> {
        let mask = self.mask_at(rate);
        if mask.is_some() { kernels::dropout(x, mask) } else { x }
    }

    /// The mask of the next layer.
    fn mask_at(&mut self, rate: f64) -> Option<DropoutMask> {
        let place = self.places;
        self.places += 1;
        let keys = self.keys.as_ref().filter(|_| rate > 0.0)?;
        Some(DropoutMask::new(keys.clone(), place, rate))
    }
}

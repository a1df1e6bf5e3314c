use burn::module::{Module, Param};
use burn::tensor::Tensor;
use kernels::{DropoutMask, Factors, PackedWeight};

use crate::activations::Activations;
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
    pub fn forward<A: Activations>(&self, x: A) -> A {
        let shape = self.shape_from(&x);
        A::operation([x], [true], shape, |[x]| {
            kernels::linear(x, self.weight.val(), self.bias.val(), &self.packed)
        })
    }

    /// The product with the weight alone. It maps rates of change of the input to those of the
    /// output.
    pub fn forward_without_bias<A: Activations>(&self, x: A) -> A {
        let shape = self.shape_from(&x);
        A::operation([x], [true], shape, |[x]| {
            let none = self.bias.val().inner().zeros_like();
            let none = Tensor::from_inner(none);
            kernels::linear(x, self.weight.val(), none, &self.packed)
        })
    }

    /// The layer after `norm`.
    pub fn forward_normed<A: Activations>(&self, x: A, norm: &LayerNorm) -> A {
        let shape = self.shape_from(&x);
        A::operation([x], [true], shape, |[x]| {
            let LayerNorm { weight, bias } = norm;
            let norm = [weight.val(), bias.val()];
            kernels::norm_linear(x, norm, self.weight.val(), self.bias.val(), &self.packed)
        })
    }

    /// Three layers of the same normed `x`, with their outputs side by side. `packed` holds the
    /// weights of all three.
    pub fn forward_three_normed<A: Activations>(
        maps: [&Self; 3],
        x: A,
        norm: &LayerNorm,
        packed: &PackedWeight,
    ) -> A {
        let [batch, tokens, _] = x.dims();
        let outputs = maps.map(Self::output).iter().sum();
        A::operation([x], [true], [batch, tokens, outputs], |[x]| {
            let norm = [norm.weight.val(), norm.bias.val()];
            let (weights, biases) =
                (maps.map(|map| map.weight.val()), maps.map(|map| map.bias.val()));
            kernels::norm_linear_of_three(x, norm, weights, biases, packed)
        })
    }

    /// `residual` plus this layer of GELU of `x`. `masks` apply dropout to the output of GELU and
    /// to that of this layer.
    pub fn forward_gelu_onto<A: Activations>(
        &self,
        residual: A,
        x: A,
        masks: [Option<DropoutMask>; 2],
    ) -> A {
        let shape = self.shape_from(&x);
        A::operation([residual, x], [true; 2], shape, |[residual, x]| {
            let (weight, bias) = (self.weight.val(), self.bias.val());
            kernels::gelu_linear_onto(residual, x, weight, bias, &self.packed, masks)
        })
    }

    fn output(&self) -> usize {
        let [output, _] = self.weight.lazy_shape().dims();
        output
    }

    fn shape_from(&self, x: &impl Activations) -> [usize; 3] {
        let [batch, tokens, _] = x.dims();
        [batch, tokens, self.output()]
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
    pub fn forward<A: Activations>(&self, x: A) -> A {
        let shape = x.dims();
        A::operation([x], [true], shape, |[x]| {
            kernels::layer_norm(x, self.weight.val(), self.bias.val())
        })
    }
}

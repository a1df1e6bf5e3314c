use burn::module::Module;
use burn::tensor::Tensor;

use crate::dropout::Dropout;
use crate::initialization::InitialWeights;
use crate::kernels::{self, Mask, PackedWeight};
use crate::layers::{LayerNorm, Linear};

/// Multi-head scaled dot-product attention (Vaswani et al. 2017), biases on.
#[derive(Module, Debug)]
pub(crate) struct Attention {
    query: Linear,
    key: Linear,
    value: Linear,
    output: Linear,
    heads: usize,
    /// Of query, key and value.
    #[module(skip)]
    packed: PackedWeight,
}

impl Attention {
    pub fn new(d_model: usize, heads: usize, weights: &mut InitialWeights<'_>) -> Self {
        Self {
            query: Linear::new(d_model, d_model, weights),
            key: Linear::new(d_model, d_model, weights),
            value: Linear::new(d_model, d_model, weights),
            output: Linear::new(d_model, d_model, weights),
            heads,
            packed: PackedWeight::default(),
        }
    }

    /// Every token of the normed `x` `[batch, token, d_model]` looks at those tokens of the same that `mask`
    /// lets it see. Gives the shape of `x`. Dropout leaves out some of what it looks at, and some of
    /// what comes of it.
    pub fn forward(
        &self,
        x: Tensor<3>,
        norm: &LayerNorm,
        mask: Mask,
        dropout: &mut Dropout,
    ) -> Tensor<3> {
        let maps = [&self.query, &self.key, &self.value];
        let projected = Linear::forward_three_normed(maps, x, norm, &self.packed);
        let mixed = kernels::self_attention(projected, self.heads, mask, dropout.mask());
        self.outcome(mixed, dropout)
    }

    /// The same of the tokens of `memory` `[batch, source, d_model]`, as they are.
    pub fn forward_across(
        &self,
        x: Tensor<3>,
        norm: &LayerNorm,
        memory: Tensor<3>,
        mask: Mask,
        dropout: &mut Dropout,
    ) -> Tensor<3> {
        let query = self.query.forward_normed(x, norm);
        let key = self.key.forward(memory.clone());
        let value = self.value.forward(memory);
        let mixed = kernels::attention(query, key, value, self.heads, mask, dropout.mask());
        self.outcome(mixed, dropout)
    }

    fn outcome(&self, mixed: Tensor<3>, dropout: &mut Dropout) -> Tensor<3> {
        kernels::dropout(self.output.forward(mixed), dropout.mask())
    }

    pub const fn parameter_count(d_model: u64) -> u64 {
        4 * Linear::parameter_count(d_model, d_model)
    }
}

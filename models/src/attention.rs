use burn::module::Module;
use burn::tensor::Tensor;

use crate::dropout::Dropout;
use crate::initialization::InitialWeights;
use crate::kernels::{self, Mask};
use crate::layers::Linear;

/// Multi-head scaled dot-product attention (Vaswani et al. 2017), biases on.
#[derive(Module, Debug)]
pub(crate) struct Attention {
    query: Linear,
    key: Linear,
    value: Linear,
    output: Linear,
    heads: usize,
}

impl Attention {
    pub fn new(d_model: usize, heads: usize, weights: &mut InitialWeights<'_>) -> Self {
        Self {
            query: Linear::new(d_model, d_model, weights),
            key: Linear::new(d_model, d_model, weights),
            value: Linear::new(d_model, d_model, weights),
            output: Linear::new(d_model, d_model, weights),
            heads,
        }
    }

    /// Every token of `x` `[batch, token, d_model]` looks at the tokens of `memory`
    /// `[batch, source, d_model]` that `mask` lets it see. Gives the shape of `x`. Dropout leaves out
    /// some of what it looks at, and some of what comes of it.
    pub fn forward(
        &self,
        x: Tensor<3>,
        memory: Tensor<3>,
        mask: Mask,
        dropout: &mut Dropout,
    ) -> Tensor<3> {
        let query = self.query.forward(x);
        let key = self.key.forward(memory.clone());
        let value = self.value.forward(memory);
        let mixed = kernels::attention(query, key, value, self.heads, mask, dropout.mask());
        kernels::dropout(self.output.forward(mixed), dropout.mask())
    }

    pub const fn parameter_count(d_model: u64) -> u64 {
        4 * Linear::parameter_count(d_model, d_model)
    }
}

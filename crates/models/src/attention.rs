//! Multi-head attention, and keys and values that several queries share.

use burn::module::Module;
use burn::tensor::Tensor;
use kernels::{Mask, PackedWeight};

use crate::initialization::InitialWeights;
use crate::layers::{Dropout, LayerNorm, Linear};
use crate::transformer::BlockShape;

/// Multi-head scaled dot-product attention (Vaswani et al. 2017), with biases.
#[derive(Module, Debug)]
pub(crate) struct Attention {
    query: Linear,
    key: Linear,
    value: Linear,
    output: Linear,
    heads: usize,
    /// The packed weights of query, key and value.
    #[module(skip)]
    packed: PackedWeight,
}

/// Keys and values of tokens, `[batch, source, d_model]` each.
#[derive(Clone, Debug)]
pub(crate) struct Sources {
    keys: Tensor<3>,
    values: Tensor<3>,
}

impl Sources {
    /// Tokens of each trajectory.
    pub fn count(&self) -> usize {
        let [_, count, _] = self.keys.dims();
        count
    }

    /// Concatenates `others` after these tokens.
    pub fn before(&self, others: Self) -> Self {
        let both = |first: &Tensor<3>, then| Tensor::cat(vec![first.clone(), then], 1);
        Self { keys: both(&self.keys, others.keys), values: both(&self.values, others.values) }
    }

    /// Repeats each trajectory as many times as `copies` says.
    pub fn copied(&self, copies: &[usize]) -> Self {
        let all = |values: &Tensor<3>| {
            let apart = values.clone().split(1, 0).into_iter().zip(copies);
            let copies = apart.flat_map(|(one, &count)| std::iter::repeat_n(one, count));
            Tensor::cat(copies.collect(), 0)
        };
        Self { keys: all(&self.keys), values: all(&self.values) }
    }

    /// Splits into groups of `batch` trajectories.
    pub fn split(self, batch: usize) -> impl Iterator<Item = Self> {
        let (keys, values) = (self.keys.split(batch, 0), self.values.split(batch, 0));
        keys.into_iter().zip(values).map(|(keys, values)| Self { keys, values })
    }
}

impl Attention {
    pub fn new(shape: BlockShape, weights: &mut InitialWeights<'_>) -> Self {
        let BlockShape { d_model, heads, factors, .. } = shape;
        let mut linear = || Linear::reading(factors, d_model, d_model, weights);
        let [query, key, value, output] = [(); 4].map(|()| linear());
        Self { query, key, value, output, heads, packed: PackedWeight::new(factors) }
    }

    /// Self-attention: every token of the normed `x` `[batch, token, d_model]` attends to the
    /// tokens of `x` that `mask` lets it see. The result has the shape of `x`. Dropout applies to
    /// the attention weights and to the output.
    pub fn forward(
        &self,
        x: Tensor<3>,
        norm: &LayerNorm,
        mask: Mask,
        dropout: &mut Dropout,
    ) -> Tensor<3> {
        let maps = [&self.query, &self.key, &self.value];
        let projected = Linear::forward_three_normed(maps, x, norm, &self.packed);
        let (left_out, factors) = (dropout.mask(), self.packed.factors());
        let mixed = kernels::self_attention(projected, self.heads, mask, left_out, factors);
        self.outcome(mixed, dropout)
    }

    /// Cross-attention: the tokens of `x` attend to those of `memory` `[batch, source, d_model]`,
    /// which is not normed.
    pub fn forward_across(
        &self,
        x: Tensor<3>,
        norm: &LayerNorm,
        memory: Tensor<3>,
        mask: Mask,
        dropout: &mut Dropout,
    ) -> Tensor<3> {
        self.forward_to(&self.sources(memory), x, norm, mask, dropout)
    }

    /// Cross-attention to `sources`, which are the keys and values of tokens.
    pub fn forward_to(
        &self,
        sources: &Sources,
        x: Tensor<3>,
        norm: &LayerNorm,
        mask: Mask,
        dropout: &mut Dropout,
    ) -> Tensor<3> {
        let query = self.query.forward_normed(x, norm);
        self.look(query, sources, mask, dropout)
    }

    /// The keys and values of the tokens of `memory`, which is not normed.
    pub fn sources(&self, memory: Tensor<3>) -> Sources {
        let keys = self.key.forward(memory.clone());
        Sources { keys, values: self.value.forward(memory) }
    }

    /// Queries of the normed `x`, and its keys and values, which later calls of [`Attention::look`]
    /// can use.
    pub fn projected(&self, x: &Tensor<3>, norm: &LayerNorm) -> (Tensor<3>, Sources) {
        let [query, keys, values] =
            [&self.query, &self.key, &self.value].map(|map| map.forward_normed(x.clone(), norm));
        (query, Sources { keys, values })
    }

    /// The output of attention of `query` to `sources`.
    pub fn look(
        &self,
        query: Tensor<3>,
        sources: &Sources,
        mask: Mask,
        dropout: &mut Dropout,
    ) -> Tensor<3> {
        let Sources { keys, values } = sources.clone();
        let (left_out, factors) = (dropout.mask(), self.packed.factors());
        let mixed = kernels::attention(query, keys, values, self.heads, mask, left_out, factors);
        self.outcome(mixed, dropout)
    }

    fn outcome(&self, mixed: Tensor<3>, dropout: &mut Dropout) -> Tensor<3> {
        dropout.apply(self.output.forward(mixed))
    }
}

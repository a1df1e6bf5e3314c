//! Transformer blocks with the norm before each part (Xiong et al. 2020), as in GPT-2. Dropout is where
//! `torch.nn.TransformerEncoderLayer` and `TransformerDecoderLayer` have it: on the weights of
//! attention, after GELU, and on what each part adds.

use burn::module::Module;
use burn::tensor::Tensor;

use crate::attention::Attention;
use crate::dropout::Dropout;
use crate::initialization::InitialWeights;
use crate::kernels::Mask;
use crate::layers::{LayerNorm, Linear};

/// Two linear maps with a GELU between.
#[derive(Module, Debug)]
pub(crate) struct FeedForward {
    expand: Linear,
    contract: Linear,
}

impl FeedForward {
    fn new(d_model: usize, hidden: usize, weights: &mut InitialWeights<'_>) -> Self {
        Self {
            expand: Linear::new(d_model, hidden, weights),
            contract: Linear::new(hidden, d_model, weights),
        }
    }

    /// x plus what becomes of the normed x.
    fn forward_onto(&self, x: Tensor<3>, norm: &LayerNorm, dropout: &mut Dropout) -> Tensor<3> {
        let hidden = self.expand.forward_normed(x.clone(), norm);
        self.contract.forward_gelu_onto(x, hidden, [dropout.mask(), dropout.mask()])
    }

    const fn parameter_count(d_model: u64, hidden: u64) -> u64 {
        Linear::parameter_count(d_model, hidden) + Linear::parameter_count(hidden, d_model)
    }
}

/// Self-attention in both directions, then the feed-forward part.
#[derive(Module, Debug)]
pub(crate) struct EncoderBlock {
    attention_norm: LayerNorm,
    attention: Attention,
    feed_forward_norm: LayerNorm,
    feed_forward: FeedForward,
}

impl EncoderBlock {
    pub fn new(
        d_model: usize,
        heads: usize,
        hidden: usize,
        weights: &mut InitialWeights<'_>,
    ) -> Self {
        Self {
            attention_norm: LayerNorm::new(d_model, weights),
            attention: Attention::new(d_model, heads, weights),
            feed_forward_norm: LayerNorm::new(d_model, weights),
            feed_forward: FeedForward::new(d_model, hidden, weights),
        }
    }

    /// `[batch, token, d_model]` to the same shape.
    pub fn forward(&self, x: Tensor<3>, dropout: &mut Dropout) -> Tensor<3> {
        let norm = &self.attention_norm;
        let x = x.clone() + self.attention.forward(x, norm, Mask::None, dropout);
        self.feed_forward.forward_onto(x, &self.feed_forward_norm, dropout)
    }

    pub const fn parameter_count(d_model: u64, hidden: u64) -> u64 {
        2 * LayerNorm::parameter_count(d_model)
            + Attention::parameter_count(d_model)
            + FeedForward::parameter_count(d_model, hidden)
    }
}

/// Causal self-attention, attention to the encoder's output, the feed-forward part.
#[derive(Module, Debug)]
pub(crate) struct DecoderBlock {
    self_attention_norm: LayerNorm,
    self_attention: Attention,
    cross_attention_norm: LayerNorm,
    cross_attention: Attention,
    feed_forward_norm: LayerNorm,
    feed_forward: FeedForward,
}

impl DecoderBlock {
    pub fn new(
        d_model: usize,
        heads: usize,
        hidden: usize,
        weights: &mut InitialWeights<'_>,
    ) -> Self {
        Self {
            self_attention_norm: LayerNorm::new(d_model, weights),
            self_attention: Attention::new(d_model, heads, weights),
            cross_attention_norm: LayerNorm::new(d_model, weights),
            cross_attention: Attention::new(d_model, heads, weights),
            feed_forward_norm: LayerNorm::new(d_model, weights),
            feed_forward: FeedForward::new(d_model, hidden, weights),
        }
    }

    /// `x` `[batch, token, d_model]` with what `mask` lets it see of `memory`
    /// `[batch, source, d_model]` to the shape of `x`.
    pub fn forward(
        &self,
        x: Tensor<3>,
        memory: Tensor<3>,
        mask: Mask,
        dropout: &mut Dropout,
    ) -> Tensor<3> {
        let causal = Mask::Causal { ahead: 0 };
        let norm = &self.self_attention_norm;
        let x = x.clone() + self.self_attention.forward(x, norm, causal, dropout);
        let norm = &self.cross_attention_norm;
        let x = x.clone() + self.cross_attention.forward_across(x, norm, memory, mask, dropout);
        self.feed_forward.forward_onto(x, &self.feed_forward_norm, dropout)
    }

    pub const fn parameter_count(d_model: u64, hidden: u64) -> u64 {
        3 * LayerNorm::parameter_count(d_model)
            + 2 * Attention::parameter_count(d_model)
            + FeedForward::parameter_count(d_model, hidden)
    }
}

//! Transformer blocks with the norm before each part (Xiong et al. 2020), as in GPT-2. Dropout has
//! the places of `torch.nn.TransformerEncoderLayer` and `TransformerDecoderLayer`: the weights of
//! attention, the output of GELU, and the output of each part.

use burn::module::Module;
use burn::tensor::Tensor;
use kernels::{Factors, Mask};
use spec::MatmulPrecision;

use crate::attention::{Attention, Sources};
use crate::initialization::InitialWeights;
use crate::layers::{Dropout, LayerNorm, Linear};

/// Sizes of a block, and the numbers that its products read.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BlockShape {
    pub d_model: usize,
    pub heads: usize,
    /// Width between the two maps of the feed-forward part.
    pub hidden: usize,
    pub factors: Factors,
}

impl BlockShape {
    pub fn new(d_model: u32, heads: u32, mlp_ratio: u32, precision: MatmulPrecision) -> Self {
        let [d_model, heads, ratio] = [d_model, heads, mlp_ratio].map(|size| size as usize);
        let factors = match precision {
            MatmulPrecision::F32 => Factors::F32,
            MatmulPrecision::Bf16 => Factors::Bf16,
        };
        Self { d_model, heads, hidden: d_model * ratio, factors }
    }
}

/// Two linear maps with a GELU between.
#[derive(Module, Debug)]
pub(crate) struct FeedForward {
    expand: Linear,
    contract: Linear,
}

impl FeedForward {
    fn new(shape: BlockShape, weights: &mut InitialWeights<'_>) -> Self {
        let BlockShape { d_model, hidden, factors, .. } = shape;
        Self {
            expand: Linear::reading(factors, d_model, hidden, weights),
            contract: Linear::reading(factors, hidden, d_model, weights),
        }
    }

    /// `x` plus the layers' output for the normed `x`.
    fn forward_onto(&self, x: Tensor<3>, norm: &LayerNorm, dropout: &mut Dropout) -> Tensor<3> {
        let hidden = self.expand.forward_normed(x.clone(), norm);
        self.contract.forward_gelu_onto(x, hidden, [dropout.mask(), dropout.mask()])
    }
}

/// Self-attention, then the feed-forward part.
#[derive(Module, Debug)]
pub(crate) struct EncoderBlock {
    attention_norm: LayerNorm,
    attention: Attention,
    feed_forward_norm: LayerNorm,
    feed_forward: FeedForward,
}

impl EncoderBlock {
    pub fn new(shape: BlockShape, weights: &mut InitialWeights<'_>) -> Self {
        let d_model = shape.d_model;
        Self {
            attention_norm: LayerNorm::new(d_model, weights),
            attention: Attention::new(shape, weights),
            feed_forward_norm: LayerNorm::new(d_model, weights),
            feed_forward: FeedForward::new(shape, weights),
        }
    }

    /// The values that a training step keeps of a trajectory of `tokens` tokens: the input, queries,
    /// keys and values, what they mix to, and the input and the hidden values of the second part.
    pub fn kept(&self, tokens: usize) -> usize {
        let [d_model, hidden] = self.feed_forward.expand.widths();
        tokens * (6 * d_model + hidden)
    }

    /// The block's output for `x` `[batch, token, d_model]`, in the same shape. `mask` says which
    /// tokens attend to each other.
    pub fn forward(&self, x: Tensor<3>, mask: Mask, dropout: &mut Dropout) -> Tensor<3> {
        let norm = &self.attention_norm;
        let x = x.clone() + self.attention.forward(x, norm, mask, dropout);
        self.feed_forward.forward_onto(x, &self.feed_forward_norm, dropout)
    }
}

/// Keys and values that tokens of a [`DecoderBlock`] attend to: those of earlier tokens, and those
/// of the encoder's output.
#[derive(Debug)]
pub(crate) struct Seen {
    own: Sources,
    memory: Sources,
}

impl Seen {
    /// Repeats each trajectory as many times as `copies` says.
    pub fn copied(&self, copies: &[usize]) -> Self {
        Self { own: self.own.copied(copies), memory: self.memory.copied(copies) }
    }

    /// Splits into groups of `batch` trajectories.
    pub fn split(self, batch: usize) -> impl Iterator<Item = Self> {
        self.own
            .split(batch)
            .zip(self.memory.split(batch))
            .map(|(own, memory)| Self { own, memory })
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
    pub fn new(shape: BlockShape, weights: &mut InitialWeights<'_>) -> Self {
        let d_model = shape.d_model;
        Self {
            self_attention_norm: LayerNorm::new(d_model, weights),
            self_attention: Attention::new(shape, weights),
            cross_attention_norm: LayerNorm::new(d_model, weights),
            cross_attention: Attention::new(shape, weights),
            feed_forward_norm: LayerNorm::new(d_model, weights),
            feed_forward: FeedForward::new(shape, weights),
        }
    }

    /// The values that a training step keeps of a trajectory of `tokens` tokens. Three more than in an
    /// [`EncoderBlock`] are kept of each token: the second attention's input, its queries and what it
    /// mixes. Two are kept of each source, its keys and values.
    pub fn kept(&self, tokens: usize, sources: usize) -> usize {
        let [d_model, hidden] = self.feed_forward.expand.widths();
        tokens * (9 * d_model + hidden) + sources * 2 * d_model
    }

    /// The block's output for `x` `[batch, token, d_model]`, in the same shape. `mask` says which
    /// of the sources in `memory` `[batch, source, d_model]` a token sees.
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
        let seen = self.cross_attention.forward_across(x.clone(), norm, memory, mask, dropout);
        let x = x + seen;
        self.feed_forward.forward_onto(x, &self.feed_forward_norm, dropout)
    }

    /// The queries of `x`, and the keys and values that these and later tokens attend to. There is
    /// no dropout.
    pub fn seen(&self, x: &Tensor<3>, memory: Tensor<3>) -> (Tensor<3>, Seen) {
        let (query, own) = self.self_attention.projected(x, &self.self_attention_norm);
        (query, Seen { own, memory: self.cross_attention.sources(memory) })
    }

    /// [`DecoderBlock::forward`] of tokens that follow those of `before`. Token t sees the sources
    /// of the memory up to t + `ahead`. There is no dropout.
    pub fn forward_after(&self, x: Tensor<3>, before: &Seen, ahead: usize) -> Tensor<3> {
        let (query, own) = self.self_attention.projected(&x, &self.self_attention_norm);
        let (own, first) = (before.own.before(own), before.own.count());
        self.finish(x, query, &own, &before.memory, [first, first + ahead])
    }

    /// [`DecoderBlock::forward`] of the first tokens of `seen`, with their queries.
    pub fn forward_seen(
        &self,
        x: Tensor<3>,
        query: Tensor<3>,
        seen: &Seen,
        ahead: usize,
    ) -> Tensor<3> {
        self.finish(x, query, &seen.own, &seen.memory, [0, ahead])
    }

    fn finish(
        &self,
        x: Tensor<3>,
        query: Tensor<3>,
        own: &Sources,
        memory: &Sources,
        ahead: [usize; 2],
    ) -> Tensor<3> {
        let dropout = &mut Dropout::off();
        let [of_own, of_memory] = ahead.map(|ahead| Mask::Causal { ahead });
        let x = x + self.self_attention.look(query, own, of_own, dropout);
        let norm = &self.cross_attention_norm;
        let x = x.clone() + self.cross_attention.forward_to(memory, x, norm, of_memory, dropout);
        self.feed_forward.forward_onto(x, &self.feed_forward_norm, dropout)
    }
}

/// `[batch, sample, channel]` to `[batch, sample / patch, patch * channel]`.
pub(crate) fn patches(series: Tensor<3>, patch: usize) -> Tensor<3> {
    let [batch, samples, channels] = series.dims();
    series.reshape([batch, samples / patch, patch * channels])
}

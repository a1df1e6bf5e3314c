mod chain;

use burn::module::{Module, Param};
use burn::tensor::Tensor;
use kernels::{DropoutKeys, Mask};
use spec::CdtSpec;

use crate::ModelError;
use crate::dropout::Dropout;
use crate::initialization::{InitialWeights, POSITION_STANDARD_DEVIATION};
use crate::layers::{LayerNorm, Linear};
use crate::sizes::{
    CHANNELS, LARGEST_RATIO, LARGEST_WIDTH, MOST_LAYERS, MOST_SAMPLES, divides, multiple, within,
};
use crate::transformer::{DecoderBlock, EncoderBlock};
use crate::unet::sinusoid;
pub(crate) use chain::Chain;

/// Of the memory's sources the token of sample t sees those up to t + this: source 0 is the noise level,
/// source s the torque of sample s - 1.
const AHEAD: usize = 1;

/// The sizes of a CDT, checked against each other.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CdtConfig {
    d_model: usize,
    heads: usize,
    encoder_layers: usize,
    decoder_layers: usize,
    hidden: usize,
    samples: usize,
    dropout: f64,
    embedding_dropout: f64,
}

impl CdtConfig {
    /// `samples` of a whole trajectory.
    pub fn new(spec: &CdtSpec, samples: u32) -> Result<Self, ModelError> {
        within("d_model", spec.d_model, 4, LARGEST_WIDTH)?;
        multiple("d_model", spec.d_model, 2, "for sine and cosine")?;
        within("encoder_layers", spec.encoder_layers, 1, MOST_LAYERS)?;
        within("decoder_layers", spec.decoder_layers, 1, MOST_LAYERS)?;
        within("mlp_ratio", spec.mlp_ratio, 1, LARGEST_RATIO)?;
        divides("heads", spec.heads, "d_model", spec.d_model)?;
        within("samples", samples, 1, MOST_SAMPLES)?;
        Ok(Self {
            d_model: spec.d_model as usize,
            heads: spec.heads as usize,
            encoder_layers: spec.encoder_layers as usize,
            decoder_layers: spec.decoder_layers as usize,
            hidden: spec.d_model as usize * spec.mlp_ratio as usize,
            samples: samples as usize,
            dropout: spec.dropout,
            embedding_dropout: spec.embedding_dropout,
        })
    }

    pub fn init(&self, weights: &mut InitialWeights<'_>) -> Cdt {
        let Self { d_model, heads, hidden, samples, .. } = *self;
        Cdt {
            condition_input: Linear::new(CHANNELS, d_model, weights),
            condition_positions: weights
                .normal([samples + 1, d_model], POSITION_STANDARD_DEVIATION),
            encoder_blocks: (0..self.encoder_layers)
                .map(|_| EncoderBlock::new(d_model, heads, hidden, weights))
                .collect(),
            input: Linear::new(CHANNELS, d_model, weights),
            positions: weights.normal([samples, d_model], POSITION_STANDARD_DEVIATION),
            decoder_blocks: (0..self.decoder_layers)
                .map(|_| DecoderBlock::new(d_model, heads, hidden, weights))
                .collect(),
            norm: LayerNorm::new(d_model, weights),
            head: Linear::new(d_model, CHANNELS, weights),
            d_model,
            dropout: self.dropout,
            embedding_dropout: self.embedding_dropout,
        }
    }

    pub fn parameter_count(&self) -> u64 {
        let (d_model, hidden) = (self.d_model as u64, self.hidden as u64);
        let channels = CHANNELS as u64;
        2 * Linear::parameter_count(channels, d_model)
            + (2 * self.samples as u64 + 1) * d_model
            + self.encoder_layers as u64 * EncoderBlock::parameter_count(d_model, hidden)
            + self.decoder_layers as u64 * DecoderBlock::parameter_count(d_model, hidden)
            + LayerNorm::parameter_count(d_model)
            + Linear::parameter_count(d_model, channels)
    }
}

/// Diffusion Transformer with a condition encoder (Chi et al. 2023, *Diffusion Policy*; the
/// network of its code).
///
/// The encoder sees the noise level and u of the whole trajectory in both directions and has no
/// norm at its end. The decoder sees the noisy y causally, and of the encoder's output at sample t
/// the noise level and u up to t.
#[derive(Module, Debug)]
pub(crate) struct Cdt {
    condition_input: Linear,
    /// `[1 + sample, d_model]`, the noise level's first.
    condition_positions: Param<Tensor<2>>,
    encoder_blocks: Vec<EncoderBlock>,
    input: Linear,
    /// `[sample, d_model]`
    positions: Param<Tensor<2>>,
    decoder_blocks: Vec<DecoderBlock>,
    norm: LayerNorm,
    head: Linear,
    d_model: usize,
    dropout: f64,
    embedding_dropout: f64,
}

impl Cdt {
    /// Noisy y `[batch, sample, 7]` at each row's noise level, given u `[batch, sample, 7]`, to
    /// the prediction in the same shape. A step of training has `keys` for what it leaves out.
    pub fn forward(
        &self,
        noisy: Tensor<3>,
        levels: &[usize],
        u: Tensor<3>,
        keys: Option<DropoutKeys>,
    ) -> Tensor<3> {
        let mut dropout = Dropout::new(keys, self.dropout);
        let mut embedded = |tokens: Tensor<3>, positions: &Param<Tensor<2>>| {
            let mask = dropout.mask_at(self.embedding_dropout);
            kernels::dropout(tokens + positions.val().unsqueeze(), mask)
        };
        let mut memory = embedded(self.condition(levels, u), &self.condition_positions);
        let mut x = embedded(self.input.forward(noisy), &self.positions);
        for block in &self.encoder_blocks {
            memory = block.forward(memory, &mut dropout);
        }
        let mask = Mask::Causal { ahead: AHEAD };
        for block in &self.decoder_blocks {
            x = block.forward(x, memory.clone(), mask, &mut dropout);
        }
        self.head.forward(self.norm.forward(x))
    }

    /// What the encoder begins with, `[batch, 1 + sample, d_model]`.
    fn condition(&self, levels: &[usize], u: Tensor<3>) -> Tensor<3> {
        let level = sinusoid(levels, self.d_model, &u.device());
        Tensor::cat(vec![level, self.condition_input.forward(u)], 1)
    }
}

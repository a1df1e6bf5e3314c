use burn::module::{Module, Param};
use burn::tensor::Tensor;
use spec::{JOINTS, RoboMorphSpec};

use crate::ModelError;
use crate::initialization::InitialWeights;
use crate::layers::{LayerNorm, Linear};
use crate::sequence_model::ModelInput;
use crate::transformer::{DecoderBlock, EncoderBlock};

/// Standard deviation of initial positions, GPT-2's.
const POSITION_STANDARD_DEVIATION: f32 = 0.02;

/// Sizes beyond these are no model but a mistake; below them no size computed here overflows.
const LARGEST_WIDTH: u32 = 1 << 14;
const MOST_LAYERS: u32 = 1 << 8;
const LARGEST_RATIO: u32 = 1 << 6;

/// The sizes of a RoboMorph, checked against each other.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RoboMorphConfig {
    d_model: usize,
    heads: usize,
    encoder_layers: usize,
    decoder_layers: usize,
    patch: usize,
    hidden: usize,
    context_tokens: usize,
    horizon_tokens: usize,
}

impl RoboMorphConfig {
    /// `context` and `horizon` in samples.
    pub fn new(spec: &RoboMorphSpec, context: u32, horizon: u32) -> Result<Self, ModelError> {
        within("d_model", spec.d_model, 1, LARGEST_WIDTH)?;
        within("encoder_layers", spec.encoder_layers, 1, MOST_LAYERS)?;
        within("decoder_layers", spec.decoder_layers, 1, MOST_LAYERS)?;
        within("mlp_ratio", spec.mlp_ratio, 1, LARGEST_RATIO)?;
        divides("heads", spec.heads, "d_model", spec.d_model)?;
        divides("patch", spec.patch, "context", context)?;
        divides("patch", spec.patch, "horizon", horizon)?;
        Ok(Self {
            d_model: spec.d_model as usize,
            heads: spec.heads as usize,
            encoder_layers: spec.encoder_layers as usize,
            decoder_layers: spec.decoder_layers as usize,
            patch: spec.patch as usize,
            hidden: spec.d_model as usize * spec.mlp_ratio as usize,
            context_tokens: (context / spec.patch) as usize,
            horizon_tokens: (horizon / spec.patch) as usize,
        })
    }

    pub fn init(&self, weights: &mut InitialWeights<'_>) -> RoboMorph {
        let Self { d_model, heads, hidden, patch, .. } = *self;
        RoboMorph {
            encoder_input: Linear::new(2 * JOINTS * patch, d_model, weights),
            encoder_positions: weights
                .normal([self.context_tokens, d_model], POSITION_STANDARD_DEVIATION),
            encoder_blocks: (0..self.encoder_layers)
                .map(|_| EncoderBlock::new(d_model, heads, hidden, weights))
                .collect(),
            encoder_norm: LayerNorm::new(d_model, weights),
            decoder_input: Linear::new(JOINTS * patch, d_model, weights),
            decoder_positions: weights
                .normal([self.horizon_tokens, d_model], POSITION_STANDARD_DEVIATION),
            decoder_blocks: (0..self.decoder_layers)
                .map(|_| DecoderBlock::new(d_model, heads, hidden, weights))
                .collect(),
            decoder_norm: LayerNorm::new(d_model, weights),
            head: Linear::new(d_model, JOINTS * patch, weights),
            patch,
        }
    }

    /// How many numbers the model has to learn.
    pub fn parameter_count(&self) -> u64 {
        let d_model = self.d_model as u64;
        let hidden = self.hidden as u64;
        let channels = (JOINTS * self.patch) as u64;
        let encoder = Linear::parameter_count(2 * channels, d_model)
            + self.context_tokens as u64 * d_model
            + self.encoder_layers as u64 * EncoderBlock::parameter_count(d_model, hidden)
            + LayerNorm::parameter_count(d_model);
        let decoder = Linear::parameter_count(channels, d_model)
            + self.horizon_tokens as u64 * d_model
            + self.decoder_layers as u64 * DecoderBlock::parameter_count(d_model, hidden)
            + LayerNorm::parameter_count(d_model);
        encoder + decoder + Linear::parameter_count(d_model, channels)
    }
}

/// Encoder-decoder Transformer that predicts the whole horizon in one pass
/// (Bazzi et al. 2024, *RoboMorph*; block structure of its code, forgi86/sysid-transformers).
///
/// A token is `patch` consecutive samples, flattened; 1 in the paper. The encoder sees u and y of
/// the context in both directions. The decoder sees u of the horizon, causally, and all of the
/// encoder's output. It is given no past y of its own and predicts positions, not differences.
#[derive(Module, Debug)]
pub(crate) struct RoboMorph {
    encoder_input: Linear,
    /// `[token, d_model]`
    encoder_positions: Param<Tensor<2>>,
    encoder_blocks: Vec<EncoderBlock>,
    encoder_norm: LayerNorm,
    decoder_input: Linear,
    /// `[token, d_model]`
    decoder_positions: Param<Tensor<2>>,
    decoder_blocks: Vec<DecoderBlock>,
    decoder_norm: LayerNorm,
    head: Linear,
    patch: usize,
}

impl RoboMorph {
    /// Gives y `[batch, horizon, 7]`, normalized as the input is.
    pub fn forward(&self, input: ModelInput) -> Tensor<3> {
        let context = patches(input.context, self.patch);
        let future_u = patches(input.future_u, self.patch);
        let [batch, horizon_tokens, channels] = future_u.dims();

        let mut memory =
            self.encoder_input.forward(context) + self.encoder_positions.val().unsqueeze();
        for block in &self.encoder_blocks {
            memory = block.forward(memory);
        }
        let memory = self.encoder_norm.forward(memory);

        let mut x = self.decoder_input.forward(future_u) + self.decoder_positions.val().unsqueeze();
        for block in &self.decoder_blocks {
            x = block.forward(x, memory.clone());
        }
        let y = self.head.forward(self.decoder_norm.forward(x));
        y.reshape([batch, horizon_tokens * self.patch, channels / self.patch])
    }
}

/// `[batch, sample, channel]` to `[batch, sample / patch, patch * channel]`.
fn patches(series: Tensor<3>, patch: usize) -> Tensor<3> {
    let [batch, samples, channels] = series.dims();
    series.reshape([batch, samples / patch, patch * channels])
}

fn within(field: &'static str, value: u32, least: u32, most: u32) -> Result<(), ModelError> {
    if (least..=most).contains(&value) {
        return Ok(());
    }
    let allowed = format!("{least} to {most}");
    Err(ModelError::Size { field, value: value.into(), allowed })
}

fn divides(
    field: &'static str,
    divisor: u32,
    of: &'static str,
    value: u32,
) -> Result<(), ModelError> {
    if divisor > 0 && value > 0 && value.is_multiple_of(divisor) {
        return Ok(());
    }
    let allowed = format!("divisors of the {of}, which is {value}");
    Err(ModelError::Size { field, value: divisor.into(), allowed })
}

#[cfg(test)]
mod tests {
    use spec::RoboMorphSpec;

    use super::RoboMorphConfig;

    /// The count that the published sizes imply: d_model 384, 12 + 12 layers, 320 + 80 samples.
    #[test]
    fn at_the_papers_sizes_there_are_49_9_million_parameters() {
        let spec = RoboMorphSpec {
            d_model: 384,
            heads: 8,
            encoder_layers: 12,
            decoder_layers: 12,
            patch: 1,
            mlp_ratio: 4,
        };
        let count = RoboMorphConfig::new(&spec, 320, 80).unwrap().parameter_count();
        assert!((49_400_000..50_400_000).contains(&count), "{count}");
    }
}

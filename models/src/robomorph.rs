use burn::module::{Module, Param};
use burn::tensor::Tensor;
use kernels::Mask;
use spec::{Head, JOINTS, RoboMorphSpec};

use crate::ModelError;
use crate::dropout::Dropout;
use crate::gaussian;
use crate::initialization::{InitialWeights, POSITION_STANDARD_DEVIATION};
use crate::layers::{LayerNorm, Linear};
use crate::sizes::{LARGEST_RATIO, LARGEST_WIDTH, MOST_LAYERS, divides, within};
use crate::transformer::{DecoderBlock, EncoderBlock};

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
    head: Head,
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
            head: spec.head,
        })
    }

    /// Numbers that the head gives for each position.
    const fn head_numbers(&self) -> usize {
        match self.head {
            Head::Point => 1,
            Head::Gaussian => gaussian::NUMBERS,
        }
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
            head: Linear::new(d_model, self.head_numbers() * JOINTS * patch, weights),
            patch,
            kind: self.head,
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
        encoder + decoder + Linear::parameter_count(d_model, self.head_numbers() as u64 * channels)
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
    #[module(skip)]
    kind: Head,
}

impl RoboMorph {
    pub fn kind(&self) -> Head {
        self.kind
    }

    /// u of whole trajectories `[batch, sample, 7]` and y of their context `[batch, context, 7]`
    /// to y of the horizon `[batch, horizon, 7]`; a gaussian head gives `[batch, horizon, 14]`,
    /// mean and logarithm of the variance as [`gaussian::split`] takes them apart.
    pub fn forward(&self, u: Tensor<3>, y_context: Tensor<3>) -> Tensor<3> {
        let [batch, samples, channels] = u.dims();
        let [_, context, _] = y_context.dims();
        let past_u = u.clone().slice([0..batch, 0..context, 0..channels]);
        let future_u = u.slice([0..batch, context..samples, 0..channels]);
        let context = patches(Tensor::cat(vec![past_u, y_context], 2), self.patch);
        let future_u = patches(future_u, self.patch);
        let [_, horizon_tokens, _] = future_u.dims();

        let mut memory =
            self.encoder_input.forward(context) + self.encoder_positions.val().unsqueeze();
        for block in &self.encoder_blocks {
            memory = block.forward(memory, &mut Dropout::off());
        }
        let memory = self.encoder_norm.forward(memory);

        let mut x = self.decoder_input.forward(future_u) + self.decoder_positions.val().unsqueeze();
        for block in &self.decoder_blocks {
            x = block.forward(x, memory.clone(), Mask::None, &mut Dropout::off());
        }
        let numbers = self.head.forward(self.decoder_norm.forward(x));
        let [_, _, width] = numbers.dims();
        numbers.reshape([batch, horizon_tokens * self.patch, width / self.patch])
    }
}

/// `[batch, sample, channel]` to `[batch, sample / patch, patch * channel]`.
fn patches(series: Tensor<3>, patch: usize) -> Tensor<3> {
    let [batch, samples, channels] = series.dims();
    series.reshape([batch, samples / patch, patch * channels])
}

#[cfg(test)]
mod tests {
    use spec::{Head, Residual, RoboMorphSpec};

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
            head: Head::Point,
            residual: Residual::None,
        };
        let count = RoboMorphConfig::new(&spec, 320, 80).unwrap().parameter_count();
        assert!((49_400_000..50_400_000).contains(&count), "{count}");
    }
}

//! Diffusion Transformer with a condition encoder.

mod chain;

use burn::module::{Module, Param};
use burn::tensor::Tensor;
use kernels::{DropoutKeys, Mask};
use spec::{CdtSpec, Objective};

use crate::ModelError;
use crate::architecture::{Architecture, Extents};
use crate::denoiser::{Denoiser, Network, Task, Torques};
use crate::diffusion::{Process, Step};
use crate::frame::KnownInputs;
use crate::initialization::{InitialWeights, POSITION_STANDARD_DEVIATION};
use crate::layers::Dropout;
use crate::layers::{LayerNorm, Linear, add_positions};
use crate::sizes::{
    LARGEST_RATIO, LARGEST_WIDTH, MOST_LAYERS, MOST_SAMPLES, divides, multiple, within,
};
use crate::transformer::{BlockShape, DecoderBlock, EncoderBlock, patches};
use crate::unet::sinusoid;
use chain::Chain;

/// Token t sees the memory's sources up to t + this. Source 0 is the noise level, and source s
/// holds the torques of token s - 1.
const AHEAD: usize = 1;

impl Architecture for CdtSpec {
    type Model = Denoiser<Cdt>;

    fn init(
        &self,
        extents: Extents,
        weights: &mut InitialWeights<'_>,
    ) -> Result<Denoiser<Cdt>, ModelError> {
        let network = Cdt::new(self, extents, weights)?;
        let task = match self.objective {
            Objective::Denoising => Task::Denoise(Process::diffusion(&self.diffusion)),
            Objective::Regression => Task::Predict(self.loss),
        };
        let known_inputs = KnownInputs::of(self.residual);
        Ok(Denoiser { network, task, torques: Torques::Apart, known_inputs })
    }
}

/// Diffusion Transformer with a condition encoder (Chi et al. 2023, *Diffusion Policy*; the
/// network of its code).
///
/// A token is `patch` consecutive samples, flattened; 1 in the paper. The encoder sees the noise
/// level and the [known](KnownInputs) series of the whole trajectory in both directions, which is u
/// alone in the paper. It has no norm at its end. The decoder sees the noisy y causally. At token t
/// it sees the noise level and u up to t in the encoder's output.
#[derive(Module, Debug)]
pub(crate) struct Cdt {
    condition_input: Linear,
    /// `[1 + token, d_model]`. The noise level comes first.
    condition_positions: Param<Tensor<2>>,
    encoder_blocks: Vec<EncoderBlock>,
    input: Linear,
    /// `[token, d_model]`
    positions: Param<Tensor<2>>,
    decoder_blocks: Vec<DecoderBlock>,
    norm: LayerNorm,
    head: Linear,
    d_model: usize,
    patch: usize,
    dropout: f64,
    embedding_dropout: f64,
}

impl Cdt {
    fn new(
        spec: &CdtSpec,
        extents: Extents,
        weights: &mut InitialWeights<'_>,
    ) -> Result<Self, ModelError> {
        within("d_model", spec.d_model, 4, LARGEST_WIDTH)?;
        multiple("d_model", spec.d_model, 2, "for sine and cosine")?;
        within("encoder_layers", spec.encoder_layers, 1, MOST_LAYERS)?;
        within("decoder_layers", spec.decoder_layers, 1, MOST_LAYERS)?;
        within("mlp_ratio", spec.mlp_ratio, 1, LARGEST_RATIO)?;
        divides("heads", spec.heads, "d_model", spec.d_model)?;
        within("samples", extents.samples(), 1, MOST_SAMPLES)?;
        divides("patch", spec.patch, "context", extents.context)?;
        divides("patch", spec.patch, "horizon", extents.horizon)?;
        let shape =
            BlockShape::new(spec.d_model, spec.heads, spec.mlp_ratio, spec.matmul_precision);
        let (d_model, patch) = (shape.d_model, spec.patch as usize);
        let tokens = extents.samples() as usize / patch;
        let known = KnownInputs::of(spec.residual).channels(extents.joints);
        Ok(Self {
            condition_input: Linear::new(known * patch, d_model, weights),
            condition_positions: weights.normal([tokens + 1, d_model], POSITION_STANDARD_DEVIATION),
            encoder_blocks: (0..spec.encoder_layers)
                .map(|_| EncoderBlock::new(shape, weights))
                .collect(),
            input: Linear::new(extents.joints * patch, d_model, weights),
            positions: weights.normal([tokens, d_model], POSITION_STANDARD_DEVIATION),
            decoder_blocks: (0..spec.decoder_layers)
                .map(|_| DecoderBlock::new(shape, weights))
                .collect(),
            norm: LayerNorm::new(d_model, weights),
            head: Linear::new(d_model, extents.joints * patch, weights),
            d_model,
            patch,
            dropout: spec.dropout,
            embedding_dropout: spec.embedding_dropout,
        })
    }

    /// The input of the encoder, `[batch, 1 + token, d_model]`.
    fn condition(&self, levels: &[usize], known: Tensor<3>) -> Tensor<3> {
        let level = sinusoid(levels, self.d_model, &known.device());
        Tensor::cat(vec![level, self.condition_input.forward(patches(known, self.patch))], 1)
    }

    /// The last block's tokens, as samples `[batch, sample, channel]`.
    fn answer(&self, x: Tensor<3>) -> Tensor<3> {
        let answer = self.head.forward(self.norm.forward(x));
        let [batch, tokens, width] = answer.dims();
        answer.reshape([batch, tokens * self.patch, width / self.patch])
    }
}

impl Network for Cdt {
    fn forward(
        &self,
        noisy: Tensor<3>,
        levels: &[usize],
        known: Tensor<3>,
        keys: Option<DropoutKeys>,
    ) -> Tensor<3> {
        let mut dropout = Dropout::new(keys, self.dropout);
        let mut embedded = |tokens: Tensor<3>, positions: &Param<Tensor<2>>| {
            dropout.apply_at(self.embedding_dropout, add_positions(tokens, positions))
        };
        let mut memory = embedded(self.condition(levels, known), &self.condition_positions);
        let mut x = embedded(self.input.forward(patches(noisy, self.patch)), &self.positions);
        for block in &self.encoder_blocks {
            memory = block.forward(memory, Mask::None, &mut dropout);
        }
        let mask = Mask::Causal { ahead: AHEAD };
        for block in &self.decoder_blocks {
            x = block.forward(x, memory.clone(), mask, &mut dropout);
        }
        self.answer(x)
    }

    fn kept(&self, extents: Extents) -> usize {
        let samples = extents.samples() as usize;
        let (tokens, sources) = (samples / self.patch, samples / self.patch + 1);
        let [known, d_model] = self.condition_input.widths();
        let [noisy, _] = self.input.widths();
        let encoder: usize = self.encoder_blocks.iter().map(|block| block.kept(sources)).sum();
        let decoder: usize =
            self.decoder_blocks.iter().map(|block| block.kept(tokens, sources)).sum();
        // Both inputs, the encoder's output, and the inputs of the last norm and of the head.
        tokens * (known + noisy) + encoder + sources * d_model + decoder + 2 * tokens * d_model
    }

    fn chain<'a>(
        &'a self,
        clean: &Tensor<3>,
        known: Tensor<3>,
        steps: &[Step],
    ) -> impl FnMut(Tensor<3>, &[usize]) -> Tensor<3> + 'a {
        let clean = clean.clone();
        let levels = steps.iter().map(|step| step.level).collect();
        let mut chain = Chain::new(self, clean.clone(), known, levels);
        move |noisy, _| {
            let ([batch, context, channels], [_, samples, _]) = (clean.dims(), noisy.dims());
            let noisy = noisy.slice([0..batch, context..samples, 0..channels]);
            // The answer on the context is not used.
            Tensor::cat(vec![clean.zeros_like(), chain.answer(noisy)], 1)
        }
    }
}

//! Encoder-decoder Transformer that predicts the whole horizon in one pass.

mod gaussian;

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::Tensor;
use kernels::Mask;
use spec::{Head, Output, PointLoss, RoboMorphSpec};

use crate::ModelError;
use crate::architecture::{Architecture, Ask, Draw, Extents, Model, ModelInput};
use crate::frame::KnownInputs;
use crate::initialization::{InitialWeights, POSITION_STANDARD_DEVIATION};
use crate::layers::Dropout;
use crate::layers::{LayerNorm, Linear, add_positions};
use crate::loss::Loss;
use crate::randomness::Noise;
use crate::sizes::{LARGEST_RATIO, LARGEST_WIDTH, MOST_LAYERS, divides, within};
use crate::transformer::{BlockShape, DecoderBlock, EncoderBlock, patches};

impl Architecture for RoboMorphSpec {
    type Model = RoboMorph;

    fn init(
        &self,
        Extents { context, horizon, joints }: Extents,
        weights: &mut InitialWeights<'_>,
    ) -> Result<RoboMorph, ModelError> {
        within("d_model", self.d_model, 1, LARGEST_WIDTH)?;
        within("encoder_layers", self.encoder_layers, 1, MOST_LAYERS)?;
        within("decoder_layers", self.decoder_layers, 1, MOST_LAYERS)?;
        within("mlp_ratio", self.mlp_ratio, 1, LARGEST_RATIO)?;
        divides("heads", self.heads, "d_model", self.d_model)?;
        divides("patch", self.patch, "context", context)?;
        divides("patch", self.patch, "horizon", horizon)?;
        let shape =
            BlockShape::new(self.d_model, self.heads, self.mlp_ratio, self.matmul_precision);
        let (d_model, patch) = (shape.d_model, self.patch as usize);
        let [context_tokens, horizon_tokens] =
            [context, horizon].map(|samples| (samples / self.patch) as usize);
        let known_inputs = KnownInputs::of(self.residual);
        let known = known_inputs.channels(joints);
        let numbers = match self.head {
            Head::Point => 1,
            Head::Gaussian => gaussian::NUMBERS,
        };
        Ok(RoboMorph {
            encoder_input: Linear::new((known + joints) * patch, d_model, weights),
            encoder_positions: weights
                .normal([context_tokens, d_model], POSITION_STANDARD_DEVIATION),
            encoder_blocks: (0..self.encoder_layers)
                .map(|_| EncoderBlock::new(shape, weights))
                .collect(),
            encoder_norm: LayerNorm::new(d_model, weights),
            decoder_input: Linear::new(known * patch, d_model, weights),
            decoder_positions: weights
                .normal([horizon_tokens, d_model], POSITION_STANDARD_DEVIATION),
            decoder_blocks: (0..self.decoder_layers)
                .map(|_| DecoderBlock::new(shape, weights))
                .collect(),
            decoder_norm: LayerNorm::new(d_model, weights),
            head: Linear::new(d_model, numbers * joints * patch, weights),
            patch,
            kind: self.head,
            output: self.output,
            loss: self.loss,
            known_inputs,
        })
    }
}

/// Arrays in the shape of the answer that the loss keeps: the answer, its differences and their squares.
const KEPT_BY_LOSS: usize = 3;

/// Encoder-decoder Transformer that predicts the whole horizon in one pass
/// (Bazzi et al. 2024, *RoboMorph*; block structure of its code, forgi86/sysid-transformers).
///
/// A token is `patch` consecutive samples, flattened; 1 in the paper. The encoder sees the
/// [known](KnownInputs) series, which is u alone in the paper, and y of the context in both
/// directions. The decoder sees the known series of the horizon, causally, and all of the encoder's
/// output. It does not see its own past y. It predicts positions, or on request displacements that
/// are summed to positions.
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
    #[module(skip)]
    output: Output,
    /// The loss of a point head.
    #[module(skip)]
    loss: PointLoss,
    #[module(skip)]
    known_inputs: KnownInputs,
}

impl RoboMorph {
    /// Maps the known series of whole trajectories `[batch, sample, channel]` and y of their
    /// context `[batch, context, joint]` to y of the horizon `[batch, horizon, joint]`. A gaussian
    /// head gives `[batch, horizon, 2 · joint]`, which [`gaussian::split`] splits into mean and
    /// logarithm of the variance.
    fn forward(&self, known: Tensor<3>, y_context: Tensor<3>) -> Tensor<3> {
        let [batch, samples, channels] = known.dims();
        let [_, context, _] = y_context.dims();
        let past = known.clone().slice([0..batch, 0..context, 0..channels]);
        let future = known.slice([0..batch, context..samples, 0..channels]);
        let context = patches(Tensor::cat(vec![past, y_context], 2), self.patch);
        let future = patches(future, self.patch);
        let [_, horizon_tokens, _] = future.dims();

        let mut memory =
            add_positions(self.encoder_input.forward(context), &self.encoder_positions);
        for block in &self.encoder_blocks {
            memory = block.forward(memory, Mask::None, &mut Dropout::off());
        }
        let memory = self.encoder_norm.forward(memory);

        let mut x = add_positions(self.decoder_input.forward(future), &self.decoder_positions);
        for block in &self.decoder_blocks {
            x = block.forward(x, memory.clone(), Mask::None, &mut Dropout::off());
        }
        let numbers = self.head.forward(self.decoder_norm.forward(x));
        let [_, _, width] = numbers.dims();
        let horizon = horizon_tokens * self.patch;
        let numbers = numbers.reshape([batch, horizon, width / self.patch]);
        let per_step = 1.0 / (horizon as f64).sqrt();
        match (self.output, self.kind) {
            (Output::Positions, _) => numbers,
            // As large as a sum of as many independent samples is.
            (Output::Displacements, Head::Point) => numbers.cumsum(1) * per_step,
            (Output::Displacements, Head::Gaussian) => {
                let [mean, rest] = gaussian::halves(&numbers);
                Tensor::cat(vec![mean.cumsum(1) * per_step, rest], 2)
            }
        }
    }
}

impl Model for RoboMorph {
    fn loss(&self, input: ModelInput, target: Tensor<3>, _: &mut Noise) -> Loss {
        let unit = input.unit_of_horizon();
        let answer = self.forward(self.known_inputs.series(&input), input.y_context);
        match self.kind {
            Head::Point => Loss::of_points(self.loss, answer, target, unit),
            Head::Gaussian => {
                let (mean, _) = gaussian::split(&answer);
                let errors = gaussian::negative_log_likelihood(&answer, target);
                let count = errors.shape().num_elements();
                Loss { errors, count, predicted: Some(mean) }
            }
        }
    }

    fn answer(&self, input: ModelInput, ask: Ask<'_>) -> Tensor<3> {
        let answer = self.forward(self.known_inputs.series(&input), input.y_context);
        if self.kind == Head::Point {
            return answer;
        }
        let (mean, log_variance) = gaussian::split(&answer);
        match ask.draw {
            Draw::Mean => mean,
            Draw::Sample => {
                let [_, horizon, channels] = mean.dims();
                let noise = ask.noise.normal([horizon, channels], &mean.device());
                mean + (log_variance * 0.5).exp() * noise
            }
        }
    }

    fn kept(&self, extents: Extents) -> usize {
        let [sources, tokens] =
            [extents.context, extents.horizon].map(|samples| samples as usize / self.patch);
        let [past, d_model] = self.encoder_input.widths();
        let ([future, _], [_, answer]) = (self.decoder_input.widths(), self.head.widths());
        let encoder: usize = self.encoder_blocks.iter().map(|block| block.kept(sources)).sum();
        let decoder: usize =
            self.decoder_blocks.iter().map(|block| block.kept(tokens, sources)).sum();
        let arrays = match self.kind {
            Head::Point => KEPT_BY_LOSS,
            Head::Gaussian => gaussian::KEPT_BY_LOSS,
        };
        // On either side the input, and what goes into the norm at the end and comes out of it.
        let encoder = sources * (past + 2 * d_model) + encoder;
        encoder + tokens * (future + 2 * d_model + arrays * answer) + decoder
    }

    fn is_generative(&self) -> bool {
        self.kind == Head::Gaussian
    }

    fn for_inference(&self) -> Self {
        self.valid()
    }

    fn visit<V: ModuleVisitor>(&self, visitor: &mut V) {
        Module::visit(self, visitor);
    }

    fn map<M: ModuleMapper>(self, mapper: &mut M) -> Self {
        Module::map(self, mapper)
    }
}

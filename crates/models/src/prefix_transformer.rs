//! Transformer with one stream of tokens over the whole trajectory.
//!
//! Its tokens, and what it makes of its velocities, are those of [`path_tokens`](crate::path_tokens).
//! Tokens of the context attend to each other. Tokens of the horizon attend to the context and,
//! causally, to the horizon.

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::Tensor;
use kernels::Mask;
use spec::PrefixTransformerSpec;

use crate::ModelError;
use crate::architecture::{Architecture, Ask, Extents, Model, ModelInput};
use crate::initialization::{InitialWeights, POSITION_STANDARD_DEVIATION};
use crate::layers::{Dropout, LayerNorm, Linear, add_positions};
use crate::loss::Loss;
use crate::path_tokens;
use crate::randomness::Noise;
use crate::sizes::{LARGEST_RATIO, LARGEST_WIDTH, MOST_LAYERS, divides, within};
use crate::transformer::{BlockShape, EncoderBlock};

impl Architecture for PrefixTransformerSpec {
    type Model = PrefixTransformer;

    fn init(
        &self,
        Extents { context, horizon, joints }: Extents,
        weights: &mut InitialWeights<'_>,
    ) -> Result<PrefixTransformer, ModelError> {
        within("d_model", self.d_model, 1, LARGEST_WIDTH)?;
        within("layers", self.layers, 1, MOST_LAYERS)?;
        within("mlp_ratio", self.mlp_ratio, 1, LARGEST_RATIO)?;
        divides("heads", self.heads, "d_model", self.d_model)?;
        path_tokens::check(self.patch, self.least_context, [context, horizon])?;
        let shape =
            BlockShape::new(self.d_model, self.heads, self.mlp_ratio, self.matmul_precision);
        let (d_model, patch) = (shape.d_model, self.patch as usize);
        let tokens = ((context + horizon) / self.patch) as usize;
        Ok(PrefixTransformer {
            input: Linear::new(path_tokens::width(joints, patch), d_model, weights),
            positions: weights.normal([tokens, d_model], POSITION_STANDARD_DEVIATION),
            blocks: (0..self.layers).map(|_| EncoderBlock::new(shape, weights)).collect(),
            norm: LayerNorm::new(d_model, weights),
            head: Linear::new(d_model, joints * patch, weights),
            patch,
            damping: path_tokens::damping(self.residual),
        })
    }
}

/// Transformer with one stream of tokens over the whole trajectory.
#[derive(Module, Debug)]
pub(crate) struct PrefixTransformer {
    input: Linear,
    /// `[token, d_model]`
    positions: Param<Tensor<2>>,
    blocks: Vec<EncoderBlock>,
    norm: LayerNorm,
    head: Linear,
    patch: usize,
    /// The path's damping, N·m·s/rad.
    damping: f64,
}

impl PrefixTransformer {
    /// Maps tokens `[batch, token, (patch + 1) · channel]` to velocities relative to the path, in
    /// units of the trajectory's speed, `[batch, horizon, joint]`. The first `known` tokens are the
    /// context's.
    fn forward(&self, tokens: Tensor<3>, known: usize, joints: usize) -> Tensor<3> {
        let mask = Mask::Prefix { length: known };
        let mut x = add_positions(self.input.forward(tokens), &self.positions);
        for block in &self.blocks {
            x = block.forward(x, mask, &mut Dropout::off());
        }
        let [batch, tokens, d_model] = x.dims();
        let x = x.slice([0..batch, known..tokens, 0..d_model]);
        let horizon = (tokens - known) * self.patch;
        let velocities = self.head.forward(self.norm.forward(x));
        velocities.reshape([batch, horizon, joints])
    }

    /// The displacement of the arm from the path, rad, `[batch, horizon, joint]`.
    fn displacement(&self, input: &ModelInput) -> Tensor<3> {
        let [_, _, joints] = input.u.dims();
        let velocities = |tokens, known| self.forward(tokens, known, joints);
        path_tokens::displacement(input, self.damping, self.patch, velocities)
    }
}

impl Model for PrefixTransformer {
    fn loss(&self, input: ModelInput, target: Tensor<3>, _: &mut Noise) -> Loss {
        path_tokens::loss(self.displacement(&input), &input, target)
    }

    fn answer(&self, input: ModelInput, _: Ask<'_>) -> Tensor<3> {
        self.displacement(&input) / input.unit_of_horizon()
    }

    fn kept(&self, extents: Extents) -> usize {
        let [tokens, horizon] =
            [extents.samples(), extents.horizon].map(|samples| samples as usize / self.patch);
        let [width, d_model] = self.input.widths();
        let blocks: usize = self.blocks.iter().map(|block| block.kept(tokens)).sum();
        // Beside the blocks, the tokens, and the inputs of the last norm and of the head.
        tokens * width + blocks + 2 * horizon * d_model + path_tokens::kept_by_loss(extents)
    }

    fn is_generative(&self) -> bool {
        false
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

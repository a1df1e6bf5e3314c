//! Transformer with one stream of tokens over the whole trajectory.
//!
//! A token is `patch` samples and the sample before them: torques, velocities, sines and cosines of
//! the angles, the distance of the arm from a path, and whether the sample lies in the horizon. In
//! the horizon, angles and velocities are the path's ([`samples`]). Tokens of the context attend to
//! each other. Tokens of the horizon attend to the context and, causally, to the horizon.
//!
//! Torques and velocities are in units of the trajectory's own speed, which is a channel as well:
//! an arm under three times the torque moves much like the same arm three times as fast. The head
//! gives each joint's velocity relative to that of the path at each sample, in the same unit. This
//! velocity is faded in from 0 within a tenth of a second and summed. So whatever the weights are,
//! a prediction continues from the last measured position with the path's velocity, and patches
//! meet without a jump.
//!
//! The loss is the metric: the root mean square of each joint's error over the horizon, averaged
//! over robots and joints. A squared error would give a robot with an error of 5° 2500 times the
//! weight of one with 0.1°.

mod samples;

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Tensor, TensorData};
use kernels::Mask;
use spec::{PrefixTransformerSpec, Residual};

use self::samples::Samples;
use crate::ModelError;
use crate::architecture::{Architecture, Ask, Extents, Model, ModelInput};
use crate::initialization::{InitialWeights, POSITION_STANDARD_DEVIATION};
use crate::layers::Dropout;
use crate::layers::{LayerNorm, Linear, add_positions};
use crate::loss::Loss;
use crate::randomness::Noise;
use crate::sizes::{LARGEST_RATIO, LARGEST_WIDTH, MOST_LAYERS, divides, within};
use crate::transformer::{BlockShape, EncoderBlock};

/// Time over which the velocity relative to the path is faded in, s. It is the time constant of the
/// heaviest joint behind its damper.
const RISE_S: f64 = 0.1;

/// Errors well below this count less, degrees.
const LEAST_ERROR_DEG: f64 = 0.01;

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
        divides("patch", self.patch, "context", context)?;
        divides("patch", self.patch, "horizon", horizon)?;
        if let Some(least) = self.least_context {
            within("least_context", least, self.patch, context)?;
            divides("patch", self.patch, "least_context", least)?;
        }
        let shape =
            BlockShape::new(self.d_model, self.heads, self.mlp_ratio, self.matmul_precision);
        let (d_model, patch) = (shape.d_model, self.patch as usize);
        let tokens = ((context + horizon) / self.patch) as usize;
        let damping = match self.residual {
            // Specs have a path of torques.
            Residual::None | Residual::Reference => 1.0,
            Residual::Integrator(path) | Residual::LaggedIntegrator(path) => path.damping,
        };
        Ok(PrefixTransformer {
            input: Linear::new(samples::channels(joints) * (patch + 1), d_model, weights),
            positions: weights.normal([tokens, d_model], POSITION_STANDARD_DEVIATION),
            blocks: (0..self.layers).map(|_| EncoderBlock::new(shape, weights)).collect(),
            norm: LayerNorm::new(d_model, weights),
            head: Linear::new(d_model, joints * patch, weights),
            patch,
            damping,
        })
    }
}

/// Arrays in the shape of the answer that the loss keeps: the errors, their unit and the prediction.
const KEPT_BY_LOSS: usize = 3;

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
        let device = input.u.device();
        let samples = Samples::of(input, self.damping);
        let [_, context, _] = input.y_context.dims();
        let tokens = samples.tokens(self.patch, &device);
        let velocities = self.forward(tokens, context / self.patch, joints);
        let [_, horizon, _] = velocities.dims();
        let steps = velocities * rise(horizon, input) * samples.speeds(&device);
        steps.cumsum(1) / input.rate_hz
    }
}

impl Model for PrefixTransformer {
    fn loss(&self, input: ModelInput, target: Tensor<3>, _: &mut Noise) -> Loss {
        let unit = input.unit_of_horizon();
        let displacement = self.displacement(&input);
        let predicted = displacement.clone().detach() / unit.clone();
        let errors = (displacement - target * unit) * 1_f64.to_degrees();
        Loss::root_mean_square(errors, LEAST_ERROR_DEG, predicted)
    }

    fn answer(&self, input: ModelInput, _: Ask<'_>) -> Tensor<3> {
        self.displacement(&input) / input.unit_of_horizon()
    }

    fn kept(&self, extents: Extents) -> usize {
        let [tokens, horizon] =
            [extents.samples(), extents.horizon].map(|samples| samples as usize / self.patch);
        let [width, d_model] = self.input.widths();
        let blocks: usize = self.blocks.iter().map(|block| block.kept(tokens)).sum();
        let answer = extents.horizon as usize * extents.joints;
        // Beside the blocks, the tokens, and the inputs of the last norm and of the head.
        tokens * width + blocks + 2 * horizon * d_model + KEPT_BY_LOSS * answer
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

/// The factor of the velocity relative to the path at each sample, `[1, horizon, 1]`.
#[expect(clippy::cast_possible_truncation, reason = "series are computed in f32")]
fn rise(horizon: usize, input: &ModelInput) -> Tensor<3> {
    let samples = RISE_S * input.rate_hz;
    let share = |sample: usize| (1.0 - (-(sample as f64) / samples).exp()) as f32;
    let shares: Vec<f32> = (1..=horizon).map(share).collect();
    Tensor::from_data(TensorData::new(shares, [1, horizon, 1]), &input.u.device())
}

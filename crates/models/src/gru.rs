//! Gated recurrent units (Cho et al. 2014) over the whole trajectory.
//!
//! Its tokens, and what it makes of its velocities, are those of [`path_tokens`](crate::path_tokens).
//! Layers read the tokens one after the other, through the context and on through the horizon. All
//! that the network knows of an arm is in its state at the end of the context.

use burn::module::{Module, ModuleMapper, ModuleVisitor};
use burn::tensor::{Tensor, activation::sigmoid};
use spec::GruSpec;

use crate::ModelError;
use crate::architecture::{Architecture, Ask, Extents, Model, ModelInput};
use crate::initialization::InitialWeights;
use crate::layers::Linear;
use crate::loss::Loss;
use crate::path_tokens;
use crate::randomness::Noise;
use crate::sizes::{LARGEST_WIDTH, MOST_LAYERS, within};

impl Architecture for GruSpec {
    type Model = Gru;

    fn init(
        &self,
        Extents { context, horizon, joints }: Extents,
        weights: &mut InitialWeights<'_>,
    ) -> Result<Gru, ModelError> {
        within("hidden", self.hidden, 1, LARGEST_WIDTH)?;
        within("layers", self.layers, 1, MOST_LAYERS)?;
        path_tokens::check(self.patch, self.least_context, [context, horizon])?;
        let (hidden, patch) = (self.hidden as usize, self.patch as usize);
        let first = path_tokens::width(joints, patch);
        let widths = (0..self.layers).map(|layer| if layer == 0 { first } else { hidden });
        Ok(Gru {
            layers: widths.map(|width| GruLayer::new(width, hidden, weights)).collect(),
            head: Linear::new(hidden, joints * patch, weights),
            patch,
            damping: path_tokens::damping(self.residual),
        })
    }
}

/// Layers of gated recurrent units, and a linear map of the last layer's states.
#[derive(Module, Debug)]
pub(crate) struct Gru {
    layers: Vec<GruLayer>,
    head: Linear,
    patch: usize,
    /// The path's damping, N·m·s/rad.
    damping: f64,
}

impl Gru {
    /// Maps tokens `[batch, token, width]` to velocities relative to the path, in units of the
    /// trajectory's speed, `[batch, horizon, joint]`. The first `known` tokens are the context's.
    fn forward(&self, tokens: Tensor<3>, known: usize, joints: usize) -> Tensor<3> {
        let x = self.layers.iter().fold(tokens, |x, layer| layer.forward(x));
        let [batch, tokens, hidden] = x.dims();
        let x = x.slice([0..batch, known..tokens, 0..hidden]);
        self.head.forward(x).reshape([batch, (tokens - known) * self.patch, joints])
    }

    /// The displacement of the arm from the path, rad, `[batch, horizon, joint]`.
    fn displacement(&self, input: &ModelInput) -> Tensor<3> {
        let [_, _, joints] = input.u.dims();
        let velocities = |tokens, known| self.forward(tokens, known, joints);
        path_tokens::displacement(input, self.damping, self.patch, velocities)
    }
}

/// A layer of gated recurrent units, with the equations of `torch.nn.GRU`.
#[derive(Module, Debug)]
struct GruLayer {
    /// Maps a token to its parts of the gates r and z and of the candidate n, one after the other.
    input: Linear,
    /// Maps a state to its parts of the same.
    state: Linear,
}

impl GruLayer {
    fn new(input: usize, hidden: usize, weights: &mut InitialWeights<'_>) -> Self {
        Self {
            input: Linear::new(input, 3 * hidden, weights),
            state: Linear::new(hidden, 3 * hidden, weights),
        }
    }

    /// The state after each token, `[batch, token, hidden]`. Before the first it is 0.
    fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        let [batch, tokens, _] = x.dims();
        let [hidden, gates] = self.state.widths();
        let device = x.device();
        let of_tokens = self.input.forward(x);
        let mut state = Tensor::zeros([batch, 1, hidden], &device);
        let mut states = Vec::with_capacity(tokens);
        for token in 0..tokens {
            let of_token = of_tokens.clone().slice([0..batch, token..token + 1, 0..gates]);
            let of_state = self.state.forward(state.clone());
            state = step(&of_token, &of_state, state);
            states.push(state.clone());
        }
        Tensor::cat(states, 1)
    }

    /// The number of values that a token keeps of one trajectory for the backward pass: the state,
    /// both gates before and after σ and as factors, the candidate with its part of the state, and
    /// the difference between state and candidate.
    fn kept(&self) -> usize {
        let [hidden, _] = self.state.widths();
        10 * hidden
    }
}

/// The state after a token, from the token's and the state's parts of gates and candidate,
/// `[batch, 1, 3 · hidden]`:
///
/// r = σ(xᵣ + hᵣ), z = σ(x_z + h_z), n = tanh(xₙ + r hₙ), h ← n + z (h − n)
fn step(of_token: &Tensor<3>, of_state: &Tensor<3>, state: Tensor<3>) -> Tensor<3> {
    let [batch, _, hidden] = state.dims();
    let part = |of: &Tensor<3>, from: usize, to: usize| {
        of.clone().slice([0..batch, 0..1, from * hidden..to * hidden])
    };
    let gates = sigmoid(part(of_token, 0, 2) + part(of_state, 0, 2));
    let candidate = part(of_token, 2, 3) + part(&gates, 0, 1) * part(of_state, 2, 3);
    let candidate = candidate.tanh();
    candidate.clone() + part(&gates, 1, 2) * (state - candidate)
}

impl Model for Gru {
    fn loss(&self, input: ModelInput, target: Tensor<3>, _: &mut Noise) -> Loss {
        path_tokens::loss(self.displacement(&input), &input, target)
    }

    fn answer(&self, input: ModelInput, _: Ask<'_>) -> Tensor<3> {
        self.displacement(&input) / input.unit_of_horizon()
    }

    fn kept(&self, extents: Extents) -> usize {
        let [tokens, horizon] =
            [extents.samples(), extents.horizon].map(|samples| samples as usize / self.patch);
        let layer = |layer: &GruLayer| tokens * (layer.input.widths()[0] + layer.kept());
        let layers: usize = self.layers.iter().map(layer).sum();
        // Beside the layers, the inputs of the head.
        layers + horizon * self.head.widths()[0] + path_tokens::kept_by_loss(extents)
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

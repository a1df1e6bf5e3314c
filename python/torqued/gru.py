"""The PyTorch twin of `crates/models/src/gru.rs`: same names, same numbers, in N·m, rad and s."""

import torch
from torch import Tensor, nn

from .path_tokens import PathTokens


class GruLayer(nn.Module):
    """A layer of gated recurrent units, with the equations of `torch.nn.GRU`. `input` and `state` hold the weights and
    biases that it calls `weight_ih`, `bias_ih`, `weight_hh` and `bias_hh`."""

    def __init__(self, width: int, hidden: int):
        super().__init__()
        self.input = nn.Linear(width, 3 * hidden)
        self.state = nn.Linear(hidden, 3 * hidden)

    def forward(self, x: Tensor) -> Tensor:
        """The state after each token, [batch, token, hidden]."""
        state = x.new_zeros(len(x), self.state.in_features)
        states = []
        for of_token in self.input(x).unbind(1):
            token_r, token_z, token_n = of_token.chunk(3, -1)
            state_r, state_z, state_n = self.state(state).chunk(3, -1)
            reset, update = (token_r + state_r).sigmoid(), (token_z + state_z).sigmoid()
            candidate = (token_n + reset * state_n).tanh()
            state = candidate + update * (state - candidate)
            states.append(state)
        return torch.stack(states, 1)


class Gru(PathTokens):
    """Layers of gated recurrent units over the whole trajectory."""

    def __init__(
        self,
        *,
        hidden: int,
        layers: int,
        patch: int = 5,
        least_context: int | None = None,
        residual: dict,
        context: int,
        samples: int,
        rate_hz: float,
        joints: int = 7,
    ):
        super().__init__(patch, least_context, residual, context, samples, rate_hz)
        widths = [self.width(joints)] + [hidden] * (layers - 1)
        self.layers = nn.ModuleList(GruLayer(width, hidden) for width in widths)
        self.head = nn.Linear(hidden, joints * patch)

    def forward(self, tokens: Tensor, known: int) -> Tensor:
        for layer in self.layers:
            tokens = layer(tokens)
        return self.by_sample(self.head(tokens[:, known:]))


TWINS = {"gru": Gru}

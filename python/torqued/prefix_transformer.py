"""The PyTorch twin of `crates/models/src/prefix_transformer.rs`: same names, same numbers, in N·m, rad and s."""

import torch
from torch import Tensor, nn

from .path_tokens import PathTokens
from .transformer import EncoderBlock


class PrefixTransformer(PathTokens):
    """Transformer with one stream of tokens over the whole trajectory. It attends to the context in both
    directions, and to the horizon causally."""

    def __init__(
        self,
        *,
        d_model: int,
        heads: int,
        layers: int,
        patch: int = 5,
        mlp_ratio: int = 4,
        least_context: int | None = None,
        residual: dict,
        context: int,
        samples: int,
        rate_hz: float,
        joints: int = 7,
    ):
        super().__init__(patch, least_context, residual, context, samples, rate_hz)
        tokens = samples // patch
        self.input = nn.Linear(self.width(joints), d_model)
        self.positions = nn.Parameter(0.02 * torch.randn(tokens, d_model))
        self.blocks = nn.ModuleList(EncoderBlock(d_model, heads, mlp_ratio * d_model) for _ in range(layers))
        self.norm = nn.LayerNorm(d_model)
        self.head = nn.Linear(d_model, joints * patch)

    def forward(self, tokens: Tensor, known: int) -> Tensor:
        count = tokens.shape[1]
        sees = torch.ones(count, count, dtype=torch.bool, device=tokens.device).tril()
        sees[:, :known] = True
        x = self.input(tokens) + self.positions[:count]
        for block in self.blocks:
            x = block(x, sees)
        return self.by_sample(self.head(self.norm(x[:, known:])))


TWINS = {"prefix-transformer": PrefixTransformer}

"""The PyTorch twin of `models/src/robomorph.rs`: same names, same layouts, same numbers."""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

JOINTS = 7


class Attention(nn.Module):
    """Multi-head scaled dot-product attention, biases on, no dropout."""

    def __init__(self, d_model: int, heads: int):
        super().__init__()
        self.query = nn.Linear(d_model, d_model)
        self.key = nn.Linear(d_model, d_model)
        self.value = nn.Linear(d_model, d_model)
        self.output = nn.Linear(d_model, d_model)
        self.heads = heads

    def forward(self, x: Tensor, memory: Tensor, causal: bool) -> Tensor:
        def split(z: Tensor) -> Tensor:
            return z.unflatten(-1, (self.heads, -1)).transpose(1, 2)

        mixed = F.scaled_dot_product_attention(
            split(self.query(x)), split(self.key(memory)), split(self.value(memory)), is_causal=causal
        )
        return self.output(mixed.transpose(1, 2).flatten(-2))


class FeedForward(nn.Module):
    def __init__(self, d_model: int, hidden: int):
        super().__init__()
        self.expand = nn.Linear(d_model, hidden)
        self.contract = nn.Linear(hidden, d_model)

    def forward(self, x: Tensor) -> Tensor:
        return self.contract(F.gelu(self.expand(x)))


class EncoderBlock(nn.Module):
    def __init__(self, d_model: int, heads: int, hidden: int):
        super().__init__()
        self.attention_norm = nn.LayerNorm(d_model)
        self.attention = Attention(d_model, heads)
        self.feed_forward_norm = nn.LayerNorm(d_model)
        self.feed_forward = FeedForward(d_model, hidden)

    def forward(self, x: Tensor) -> Tensor:
        normed = self.attention_norm(x)
        x = x + self.attention(normed, normed, causal=False)
        return x + self.feed_forward(self.feed_forward_norm(x))


class DecoderBlock(nn.Module):
    def __init__(self, d_model: int, heads: int, hidden: int):
        super().__init__()
        self.self_attention_norm = nn.LayerNorm(d_model)
        self.self_attention = Attention(d_model, heads)
        self.cross_attention_norm = nn.LayerNorm(d_model)
        self.cross_attention = Attention(d_model, heads)
        self.feed_forward_norm = nn.LayerNorm(d_model)
        self.feed_forward = FeedForward(d_model, hidden)

    def forward(self, x: Tensor, memory: Tensor) -> Tensor:
        normed = self.self_attention_norm(x)
        x = x + self.self_attention(normed, normed, causal=True)
        x = x + self.cross_attention(self.cross_attention_norm(x), memory, causal=False)
        return x + self.feed_forward(self.feed_forward_norm(x))


class RoboMorph(nn.Module):
    """Predicts the horizon in one pass. A token is `patch` consecutive samples, flattened."""

    def __init__(
        self,
        *,
        d_model: int,
        heads: int,
        encoder_layers: int,
        decoder_layers: int,
        patch: int = 1,
        mlp_ratio: int = 4,
        context: int,
        horizon: int,
    ):
        super().__init__()
        hidden = mlp_ratio * d_model
        self.patch = patch
        self.encoder_input = nn.Linear(2 * JOINTS * patch, d_model)
        self.encoder_positions = nn.Parameter(0.02 * torch.randn(context // patch, d_model))
        self.encoder_blocks = nn.ModuleList(
            EncoderBlock(d_model, heads, hidden) for _ in range(encoder_layers)
        )
        self.encoder_norm = nn.LayerNorm(d_model)
        self.decoder_input = nn.Linear(JOINTS * patch, d_model)
        self.decoder_positions = nn.Parameter(0.02 * torch.randn(horizon // patch, d_model))
        self.decoder_blocks = nn.ModuleList(
            DecoderBlock(d_model, heads, hidden) for _ in range(decoder_layers)
        )
        self.decoder_norm = nn.LayerNorm(d_model)
        self.head = nn.Linear(d_model, JOINTS * patch)

    def forward(self, context: Tensor, future_u: Tensor) -> Tensor:
        """Normalized u and y of the context [batch, context, 14] and u of the horizon
        [batch, horizon, 7] to y of the horizon [batch, horizon, 7]."""
        memory = self.encoder_input(self._patches(context)) + self.encoder_positions
        for block in self.encoder_blocks:
            memory = block(memory)
        memory = self.encoder_norm(memory)
        x = self.decoder_input(self._patches(future_u)) + self.decoder_positions
        for block in self.decoder_blocks:
            x = block(x, memory)
        return self.head(self.decoder_norm(x)).reshape(future_u.shape)

    def _patches(self, series: Tensor) -> Tensor:
        batch, samples, channels = series.shape
        return series.reshape(batch, samples // self.patch, self.patch * channels)

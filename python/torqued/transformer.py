"""The PyTorch twin of `crates/models/src/transformer.rs`: the blocks of RoboMorph and CDT.

Dropout has the same places and the same rate as in torqued, but drops other values.
"""

import torch.nn.functional as F
from torch import Tensor, nn


class Attention(nn.Module):
    """Multi-head scaled dot-product attention, with biases."""

    def __init__(self, d_model: int, heads: int, dropout: float):
        super().__init__()
        self.query = nn.Linear(d_model, d_model)
        self.key = nn.Linear(d_model, d_model)
        self.value = nn.Linear(d_model, d_model)
        self.output = nn.Linear(d_model, d_model)
        self.heads = heads
        self.dropout = nn.Dropout(dropout)

    def forward(self, x: Tensor, memory: Tensor, causal: bool, mask: Tensor | None = None) -> Tensor:
        def split(z: Tensor) -> Tensor:
            return z.unflatten(-1, (self.heads, -1)).transpose(1, 2)

        mixed = F.scaled_dot_product_attention(
            split(self.query(x)),
            split(self.key(memory)),
            split(self.value(memory)),
            mask,
            dropout_p=self.dropout.p if self.training else 0.0,
            is_causal=causal,
        )
        return self.dropout(self.output(mixed.transpose(1, 2).flatten(-2)))


class FeedForward(nn.Module):
    def __init__(self, d_model: int, hidden: int, dropout: float):
        super().__init__()
        self.expand = nn.Linear(d_model, hidden)
        self.contract = nn.Linear(hidden, d_model)
        self.dropout = nn.Dropout(dropout)

    def forward(self, x: Tensor) -> Tensor:
        return self.dropout(self.contract(self.dropout(F.gelu(self.expand(x)))))


class EncoderBlock(nn.Module):
    def __init__(self, d_model: int, heads: int, hidden: int, dropout: float = 0.0):
        super().__init__()
        self.attention_norm = nn.LayerNorm(d_model)
        self.attention = Attention(d_model, heads, dropout)
        self.feed_forward_norm = nn.LayerNorm(d_model)
        self.feed_forward = FeedForward(d_model, hidden, dropout)

    def forward(self, x: Tensor, mask: Tensor | None = None) -> Tensor:
        """`mask` [token, token] is true where a token may attend to another."""
        normed = self.attention_norm(x)
        x = x + self.attention(normed, normed, False, mask)
        return x + self.feed_forward(self.feed_forward_norm(x))


class DecoderBlock(nn.Module):
    def __init__(self, d_model: int, heads: int, hidden: int, dropout: float = 0.0):
        super().__init__()
        self.self_attention_norm = nn.LayerNorm(d_model)
        self.self_attention = Attention(d_model, heads, dropout)
        self.cross_attention_norm = nn.LayerNorm(d_model)
        self.cross_attention = Attention(d_model, heads, dropout)
        self.feed_forward_norm = nn.LayerNorm(d_model)
        self.feed_forward = FeedForward(d_model, hidden, dropout)

    def forward(self, x: Tensor, memory: Tensor, mask: Tensor | None = None) -> Tensor:
        """`mask` [token, source] is true where a token of x may attend to one of memory."""
        normed = self.self_attention_norm(x)
        x = x + self.self_attention(normed, normed, causal=True)
        x = x + self.cross_attention(self.cross_attention_norm(x), memory, False, mask)
        return x + self.feed_forward(self.feed_forward_norm(x))

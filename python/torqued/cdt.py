"""The PyTorch twin of `models/src/cdt`."""

import torch
from torch import Tensor, nn

from .transformer import DecoderBlock, EncoderBlock
from .unet import sinusoid


class Cdt(nn.Module):
    """Diffusion Transformer with a condition encoder (Chi et al. 2023)."""

    def __init__(
        self,
        *,
        d_model: int,
        heads: int,
        encoder_layers: int,
        decoder_layers: int,
        mlp_ratio: int = 4,
        dropout: float = 0.0,
        embedding_dropout: float = 0.0,
        samples: int,
        joints: int = 7,
    ):
        super().__init__()
        self.channels = joints
        hidden = mlp_ratio * d_model
        self.d_model = d_model
        self.condition_input = nn.Linear(joints, d_model)
        self.condition_positions = nn.Parameter(0.02 * torch.randn(samples + 1, d_model))
        self.encoder_blocks = nn.ModuleList(
            EncoderBlock(d_model, heads, hidden, dropout) for _ in range(encoder_layers)
        )
        self.input = nn.Linear(joints, d_model)
        self.positions = nn.Parameter(0.02 * torch.randn(samples, d_model))
        self.decoder_blocks = nn.ModuleList(
            DecoderBlock(d_model, heads, hidden, dropout) for _ in range(decoder_layers)
        )
        self.norm = nn.LayerNorm(d_model)
        self.embedding_dropout = nn.Dropout(embedding_dropout)
        self.head = nn.Linear(d_model, joints)
        # Sample t sees the noise level, which is source 0, and u up to its own.
        sees = torch.ones(samples, samples + 1, dtype=torch.bool).tril(1)
        self.register_buffer("sees", sees, persistent=False)

    def forward(self, noisy: Tensor, levels: Tensor, u: Tensor) -> Tensor:
        """Noisy y [batch, sample, joint] at levels [batch] with u [batch, sample, joint]."""
        level = sinusoid(levels, self.d_model).to(noisy.dtype)[:, None]
        condition = torch.cat([level, self.condition_input(u)], 1)
        memory = self.embedding_dropout(condition + self.condition_positions)
        for block in self.encoder_blocks:
            memory = block(memory)
        x = self.embedding_dropout(self.input(noisy) + self.positions)
        for block in self.decoder_blocks:
            x = block(x, memory, self.sees)
        return self.head(self.norm(x))


TWINS = {"cdt": Cdt}

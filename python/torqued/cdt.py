"""The PyTorch twin of `crates/models/src/cdt`."""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from .loss import point_loss
from .transformer import DecoderBlock, EncoderBlock
from .unet import sinusoid


class Cdt(nn.Module):
    """Diffusion Transformer with a condition encoder (Chi et al. 2023). A token is `patch` consecutive samples,
    flattened. With the objective `regression` it answers in one pass."""

    def __init__(
        self,
        *,
        d_model: int,
        heads: int,
        encoder_layers: int,
        decoder_layers: int,
        patch: int = 1,
        mlp_ratio: int = 4,
        dropout: float = 0.0,
        embedding_dropout: float = 0.0,
        objective: str = "denoising",
        loss: str = "mean-square",
        samples: int,
        joints: int = 7,
        series_per_joint: int = 1,
    ):
        super().__init__()
        self.channels, self.series_per_joint = joints, series_per_joint
        self.patch = patch
        if objective == "regression":
            self.answer, self.loss = self._answer, self._loss
        self.by_root = loss == "root-mean-square"
        tokens = samples // patch
        hidden = mlp_ratio * d_model
        self.d_model = d_model
        self.condition_input = nn.Linear(series_per_joint * joints * patch, d_model)
        self.condition_positions = nn.Parameter(0.02 * torch.randn(tokens + 1, d_model))
        self.encoder_blocks = nn.ModuleList(
            EncoderBlock(d_model, heads, hidden, dropout) for _ in range(encoder_layers)
        )
        self.input = nn.Linear(joints * patch, d_model)
        self.positions = nn.Parameter(0.02 * torch.randn(tokens, d_model))
        self.decoder_blocks = nn.ModuleList(
            DecoderBlock(d_model, heads, hidden, dropout) for _ in range(decoder_layers)
        )
        self.norm = nn.LayerNorm(d_model)
        self.embedding_dropout = nn.Dropout(embedding_dropout)
        self.head = nn.Linear(d_model, joints * patch)
        # Token t sees the noise level, which is source 0, and u up to t.
        sees = torch.ones(tokens, tokens + 1, dtype=torch.bool).tril(1)
        self.register_buffer("sees", sees, persistent=False)

    def forward(self, noisy: Tensor, levels: Tensor, known: Tensor) -> Tensor:
        """The network's answer to noisy y [batch, sample, joint] at levels [batch], with the known series [batch,
        sample, channel]."""
        level = sinusoid(levels, self.d_model).to(noisy.dtype)[:, None]
        condition = torch.cat([level, self.condition_input(self._patches(known))], 1)
        memory = self.embedding_dropout(condition + self.condition_positions)
        for block in self.encoder_blocks:
            memory = block(memory)
        x = self.embedding_dropout(self.input(self._patches(noisy)) + self.positions)
        for block in self.decoder_blocks:
            x = block(x, memory, self.sees)
        return self.head(self.norm(x)).reshape(noisy.shape)

    def _answer(self, known: Tensor, seen: Tensor) -> Tensor:
        """y of the horizon in the frame, from the known series [batch, sample, channel] and y of the context."""
        context = seen.shape[1]
        series = F.pad(seen, (0, 0, 0, known.shape[1] - context))
        return self(series, torch.zeros(len(known), dtype=torch.long), known)[:, context:]

    def _loss(self, known: Tensor, seen: Tensor, y_horizon: Tensor, unit: Tensor) -> Tensor:
        return point_loss(self._answer(known, seen) - y_horizon, unit, self.by_root)

    def _patches(self, series: Tensor) -> Tensor:
        batch, samples, channels = series.shape
        return series.reshape(batch, samples // self.patch, self.patch * channels)


TWINS = {"cdt": Cdt}

"""The PyTorch twin of `crates/models/src/robomorph`: same names, same layouts, same numbers."""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from .loss import point_loss
from .transformer import DecoderBlock, EncoderBlock


class RoboMorph(nn.Module):
    """A network that predicts the horizon in one pass. A token is `patch` consecutive samples, flattened."""

    def __init__(
        self,
        *,
        d_model: int,
        heads: int,
        encoder_layers: int,
        decoder_layers: int,
        patch: int = 1,
        mlp_ratio: int = 4,
        head: str = "point",
        output: str = "positions",
        loss: str = "mean-square",
        context: int,
        horizon: int,
        joints: int = 7,
        series_per_joint: int = 1,
    ):
        super().__init__()
        hidden = mlp_ratio * d_model
        self.patch, self.series_per_joint, self.joints = patch, series_per_joint, joints
        self.gaussian = head == "gaussian"
        self.by_root = loss == "root-mean-square"
        self.sums = output == "displacements"
        self.encoder_input = nn.Linear((series_per_joint + 1) * joints * patch, d_model)
        self.encoder_positions = nn.Parameter(0.02 * torch.randn(context // patch, d_model))
        self.encoder_blocks = nn.ModuleList(
            EncoderBlock(d_model, heads, hidden) for _ in range(encoder_layers)
        )
        self.encoder_norm = nn.LayerNorm(d_model)
        self.decoder_input = nn.Linear(series_per_joint * joints * patch, d_model)
        self.decoder_positions = nn.Parameter(0.02 * torch.randn(horizon // patch, d_model))
        self.decoder_blocks = nn.ModuleList(
            DecoderBlock(d_model, heads, hidden) for _ in range(decoder_layers)
        )
        self.decoder_norm = nn.LayerNorm(d_model)
        self.head = nn.Linear(d_model, joints * patch * (2 if self.gaussian else 1))

    def forward(self, context: Tensor, future: Tensor) -> Tensor:
        """Predicts y of the horizon [batch, horizon, joint]. The inputs are the known series of the context, u
        first, with its normalized y [batch, context, channel + joint], and the known series of the horizon [batch,
        horizon, channel]. With the output `displacements` it predicts these and gives their running sum. A gaussian
        head gives [batch, horizon, 2 * joint], see `mean_and_log_variance`."""
        memory = self.encoder_input(self._patches(context)) + self.encoder_positions
        for block in self.encoder_blocks:
            memory = block(memory)
        memory = self.encoder_norm(memory)
        x = self.decoder_input(self._patches(future)) + self.decoder_positions
        for block in self.decoder_blocks:
            x = block(x, memory)
        batch, horizon, _ = future.shape
        numbers = self.head(self.decoder_norm(x)).reshape(batch, horizon, -1)
        if not self.sums:
            return numbers
        # Only the mean is summed, and not a gaussian head's variance.
        mean, variance = numbers[..., : self.joints], numbers[..., self.joints :]
        return torch.cat([mean.cumsum(1) / horizon**0.5, variance], -1)

    def answer(self, known: Tensor, y_context: Tensor) -> Tensor:
        """y of the horizon from the known series [batch, samples, channel] and y of the context. A gaussian head
        gives the mean."""
        numbers = self._numbers(known, y_context)
        return self.mean_and_log_variance(numbers)[0] if self.gaussian else numbers

    def loss(self, known: Tensor, y_context: Tensor, y_horizon: Tensor, unit: Tensor) -> Tensor:
        """The mean squared error or `point_loss`. With a gaussian head it is the mean negative log-likelihood."""
        numbers = self._numbers(known, y_context)
        if not self.gaussian:
            return point_loss(numbers - y_horizon, unit, self.by_root)
        mean, log_variance = self.mean_and_log_variance(numbers)
        return 0.5 * ((y_horizon - mean) ** 2 * torch.exp(-log_variance) + log_variance).mean()

    def _numbers(self, known: Tensor, y_context: Tensor) -> Tensor:
        context = y_context.shape[1]
        return self(torch.cat([known[:, :context], y_context], -1), known[:, context:])

    @staticmethod
    def mean_and_log_variance(numbers: Tensor) -> tuple[Tensor, Tensor]:
        """Splits the output of a gaussian head. The bounds of the log variance, -14 and 4, are soft."""
        mean, raw = numbers.chunk(2, dim=-1)
        capped = raw - F.softplus(raw - 4.0)
        return mean, capped + F.softplus(-14.0 - capped)

    def _patches(self, series: Tensor) -> Tensor:
        batch, samples, channels = series.shape
        return series.reshape(batch, samples // self.patch, self.patch * channels)


TWINS = {"robomorph": RoboMorph}

"""The PyTorch twin of `crates/models/src/unet/`: the parts that Diffuser and CDCNN share."""

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn

GROUPS = 8
KERNEL = 5


def sinusoid(levels: Tensor, width: int) -> Tensor:
    """Sines, then cosines, of the noise levels [batch]: [batch, width]."""
    half = width // 2
    exponents = torch.arange(half, dtype=torch.float64, device=levels.device) / (half - 1)
    angles = levels.double()[:, None] * torch.exp(-math.log(10_000.0) * exponents)
    return torch.cat([angles.sin(), angles.cos()], -1)


class ConvBlock(nn.Module):
    def __init__(self, inputs: int, outputs: int):
        super().__init__()
        self.conv = nn.Conv1d(inputs, outputs, KERNEL, padding=KERNEL // 2)
        self.norm = nn.GroupNorm(GROUPS, outputs)

    def forward(self, x: Tensor) -> Tensor:
        return F.mish(self.norm(self.conv(x)))


class ResidualBlock(nn.Module):
    """Two convolutions. Between them the condition is added, or it scales and shifts (FiLM)."""

    def __init__(self, inputs: int, outputs: int, condition: int, film: bool):
        super().__init__()
        self.film = film
        self.first = ConvBlock(inputs, outputs)
        self.second = ConvBlock(outputs, outputs)
        self.condition = nn.Linear(condition, 2 * outputs if film else outputs)
        self.skip = nn.Conv1d(inputs, outputs, 1) if inputs != outputs else None

    def forward(self, x: Tensor, condition: Tensor) -> Tensor:
        hidden = self.first(x)
        shift = self.condition(F.mish(condition))[:, :, None]
        if self.film:
            scale, shift = shift.chunk(2, dim=1)
            hidden = scale * hidden
        hidden = self.second(hidden + shift)
        return hidden + (x if self.skip is None else self.skip(x))


class LevelEmbedding(nn.Module):
    def __init__(self, width: int):
        super().__init__()
        self.width = width
        self.expand = nn.Linear(width, 4 * width)
        self.contract = nn.Linear(4 * width, width)

    def forward(self, levels: Tensor) -> Tensor:
        embedded = sinusoid(levels, self.width).to(self.expand.weight.dtype)
        return self.contract(F.mish(self.expand(embedded)))


class DownStage(nn.Module):
    def __init__(self, inputs: int, outputs: int, condition: int, film: bool, last: bool):
        super().__init__()
        self.first = ResidualBlock(inputs, outputs, condition, film)
        self.second = ResidualBlock(outputs, outputs, condition, film)
        self.downsample = None if last else nn.Conv1d(outputs, outputs, 3, stride=2, padding=1)


class UpStage(nn.Module):
    def __init__(self, inputs: int, outputs: int, condition: int, film: bool):
        super().__init__()
        self.first = ResidualBlock(2 * inputs, outputs, condition, film)
        self.second = ResidualBlock(outputs, outputs, condition, film)
        self.upsample = nn.ConvTranspose1d(outputs, outputs, 4, stride=2, padding=1)


class UNet(nn.Module):
    def __init__(self, channels: int, widths: list[int], condition: int, film: bool, beside: int = 0):
        super().__init__()
        inputs = [channels + beside, *widths[:-1]]
        last = len(widths) - 1
        self.down = nn.ModuleList(
            DownStage(i, o, condition, film, index == last) for index, (i, o) in enumerate(zip(inputs, widths))
        )
        self.middle = nn.ModuleList(ResidualBlock(widths[-1], widths[-1], condition, film) for _ in range(2))
        self.up = nn.ModuleList(
            UpStage(widths[level], widths[level - 1], condition, film) for level in range(last, 0, -1)
        )
        self.last = ConvBlock(widths[0], widths[0])
        self.output = nn.Conv1d(widths[0], channels, 1)

    def forward(self, x: Tensor, condition: Tensor, local: Tensor | None = None) -> Tensor:
        """Maps x [batch, channel + beside, sample] to [batch, channel, sample], with condition [batch, width].
        `local` is added after the first block."""
        skips = []
        for index, stage in enumerate(self.down):
            x = stage.first(x, condition)
            if index == 0 and local is not None:
                x = x + local
            x = stage.second(x, condition)
            skips.append(x)
            if stage.downsample is not None:
                x = stage.downsample(x)
        for block in self.middle:
            x = block(x, condition)
        for stage in self.up:
            x = stage.first(torch.cat([x, skips.pop()], 1), condition)
            x = stage.upsample(stage.second(x, condition))
        return self.output(self.last(x))

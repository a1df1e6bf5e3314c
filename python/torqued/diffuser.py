"""The PyTorch twin of `crates/models/src/diffuser.rs`."""

import torch
from torch import Tensor, nn

from .unet import LevelEmbedding, UNet


class Diffuser(nn.Module):
    """Temporal U-Net on u and y of whole trajectories (Janner et al. 2022)."""

    def __init__(self, *, width: int, multipliers: list[int], joints: int = 7, series_per_joint: int = 1):
        super().__init__()
        self.channels, self.series_per_joint, self.joints = 2 * joints, series_per_joint, joints
        self.embedding = LevelEmbedding(width)
        widths = [width * factor for factor in multipliers]
        self.unet = UNet(self.channels, widths, width, film=False, beside=(series_per_joint - 1) * joints)

    def forward(self, noisy: Tensor, levels: Tensor, known: Tensor) -> Tensor:
        """The network's answer to noisy u and y [batch, sample, 2 * joint] at levels [batch], with the known series
        [batch, sample, channel]. Its u is not used, because it is in the noisy series."""
        series = torch.cat([noisy, known[..., self.joints :]], -1)
        return self.unet(series.transpose(1, 2), self.embedding(levels)).transpose(1, 2)


TWINS = {"diffuser": Diffuser}

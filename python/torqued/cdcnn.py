"""The PyTorch twin of `crates/models/src/cdcnn.rs`."""

import torch
from torch import Tensor, nn

from .unet import LevelEmbedding, ResidualBlock, UNet


class Cdcnn(nn.Module):
    """Conditional U-Net on y (Chi et al. 2023). The known part of each sample enters locally, or flattened through
    FiLM."""

    def __init__(
        self,
        *,
        embedding: int,
        widths: list[int],
        conditioning: str = "local",
        samples: int,
        joints: int = 7,
        series_per_joint: int = 1,
    ):
        super().__init__()
        self.channels, self.series_per_joint = joints, series_per_joint
        known = series_per_joint * joints
        self.embedding = LevelEmbedding(embedding)
        is_global = conditioning == "global"
        condition = embedding + (samples * known if is_global else 0)
        self.unet = UNet(self.channels, widths, condition, film=True)
        self.local = None if is_global else ResidualBlock(known, widths[0], condition, film=True)

    def forward(self, noisy: Tensor, levels: Tensor, known: Tensor) -> Tensor:
        """The network's answer to noisy y [batch, sample, joint] at levels [batch], with the known series [batch,
        sample, channel]."""
        condition = self.embedding(levels)
        local = None
        if self.local is None:
            condition = torch.cat([condition, known.flatten(1)], -1)
        else:
            local = self.local(known.transpose(1, 2), condition)
        return self.unet(noisy.transpose(1, 2), condition, local).transpose(1, 2)


TWINS = {"cdcnn": Cdcnn}

"""The PyTorch twin of `models/src/diffuser.rs`."""

from torch import Tensor, nn

from .unet import LevelEmbedding, UNet


class Diffuser(nn.Module):
    """Temporal U-Net on u and y of whole trajectories (Janner et al. 2022)."""

    def __init__(self, *, width: int, multipliers: list[int], joints: int = 7):
        super().__init__()
        self.channels = 2 * joints
        self.embedding = LevelEmbedding(width)
        self.unet = UNet(self.channels, [width * factor for factor in multipliers], width, film=False)

    def forward(self, noisy: Tensor, levels: Tensor, u: Tensor) -> Tensor:
        """Noisy u and y [batch, sample, 2 * joint] at levels [batch]; `u` is already in it."""
        return self.unet(noisy.transpose(1, 2), self.embedding(levels)).transpose(1, 2)


TWINS = {"diffuser": Diffuser}

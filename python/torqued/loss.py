"""The PyTorch twin of `crates/models/src/loss.rs`."""

from torch import Tensor

LEAST_NORMALIZED = 1e-4
"""Errors of normalized positions well below this count less in a root mean square."""


def point_loss(errors: Tensor, unit: Tensor, by_root: bool) -> Tensor:
    """The mean of squared errors [batch, horizon, joint], or the mean over trajectories and joints of the root of
    their mean over the horizon, in `unit` [batch, samples, joint]."""
    if not by_root:
        return errors.square().mean()
    errors = errors * unit[:, -errors.shape[1] :]
    return (errors.square().mean(1) + LEAST_NORMALIZED**2).sqrt().mean()

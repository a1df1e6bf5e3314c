"""The PyTorch twin of `models/src/frame.rs`: y = center + scale · what the network sees."""

import torch
from torch import Tensor

SMALLEST_SCALE = 1e-3


def frames(config: dict, u: Tensor, y_context: Tensor, y_mean: Tensor, y_std: Tensor) -> tuple[Tensor, Tensor]:
    """Center [batch, samples, joint] and scale [.., 1, 7], from u in N·m and y of the context in rad."""
    residual = config["model"].get("residual", "none")
    if residual == "none":
        return y_mean.expand(u.shape), y_std
    context, samples = config["context"], config["samples"]
    gain = 1.0 / (residual["integrator"]["damping"] * config["rate_hz"])
    travelled = torch.zeros(u.shape, dtype=torch.float64)
    travelled[:, 1:] = gain * u[:, :-1].double().cumsum(1)
    last = context - 1
    start = y_context[:, last : last + 1].double()
    center = start + travelled - travelled[:, last : last + 1]
    first = max(last - (samples - context), 0)
    errors = (y_context.double() - center[:, :context])[:, first:last]
    scale = errors.square().sum(1, keepdim=True).div(max(last - first, 1)).sqrt()
    return center.float(), scale.clamp(min=SMALLEST_SCALE).float()

"""The PyTorch twin of `crates/models/src/frame.rs`: y = center + scale · the network's value."""

import torch
from torch import Tensor

SMALLEST_SCALE = 1e-3

STRIDE = 8
"""Distance between two starts of a lagged path in the context, samples."""

LEAST_ERROR_RAD = 1e-5
LEAST_ERROR = 0.02
"""The least unit of a lagged path, as a share of the path's own displacement."""


def frames(config: dict, u: Tensor, y_context: Tensor, y_mean: Tensor, y_std: Tensor) -> tuple[Tensor, Tensor]:
    """Center and scale [batch, samples, joint], from u in N·m and y of the context in rad."""
    residual = config["model"].get("residual", "none")
    if residual == "none":
        return y_mean.expand(u.shape), y_std.expand(u.shape)
    context, samples = y_context.shape[1], u.shape[1]
    if residual == "reference":
        center = y_context[:, -1:] + (u - u[:, context - 1 : context])
        return center, _scale(center.double(), y_context, samples)
    [(kind, integrator)] = residual.items()
    gain = 1.0 / (integrator["damping"] * config["rate_hz"])
    travelled = torch.zeros(u.shape, dtype=torch.float64)
    travelled[:, 1:] = gain * u[:, :-1].double().cumsum(1)
    last = context - 1
    start = y_context[:, last : last + 1].double()
    center = start + travelled - travelled[:, last : last + 1]
    scale = _scale(center, y_context, samples).double()
    if kind == "lagged-integrator":
        ahead, error = lagged_path(gain * u.double(), y_context.double(), samples - context)
        center[:, context:], scale[:, context:] = ahead, error
    return center.float(), scale.float()


def _scale(center: Tensor, y_context: Tensor, samples: int) -> Tensor:
    """The error of a path over as many samples of the context as the horizon has, at every sample."""
    context = y_context.shape[1]
    last = context - 1
    first = max(last - (samples - context), 0)
    errors = (y_context.double() - center[:, :context])[:, first:last]
    scale = errors.square().sum(1, keepdim=True).div(max(last - first, 1)).sqrt()
    return scale.clamp(min=SMALLEST_SCALE).expand(center.shape).clone().float()


def known_series_per_joint(config: dict) -> int:
    """The number of known series per joint, the twin of `crates/models/src/frame.rs`."""
    return 1 if config["model"].get("residual", "none") == "none" else 3


def known_series(network: torch.nn.Module, u: Tensor, path: Tensor, unit: Tensor) -> Tensor:
    """The known series [batch, samples, channel], all normalized: the torques. For a network whose answers are
    relative to a path they also have that path, and a quarter of the logarithm of the unit."""
    return torch.cat([u, path, 0.25 * unit.log()], -1) if getattr(network, "series_per_joint", 1) > 1 else u


def lagged_path(driven: Tensor, y: Tensor, horizon: int) -> tuple[Tensor, Tensor]:
    """The path over the horizon and its error, [batch, horizon, joint]. The error of sample k is the path's error
    after k samples in the context.

    `driven` [batch, samples, joint] is the displacement per sample without a lag, and `y` is that of the context,
    both in rad. It is the twin of `crates/models/src/lag.rs`.
    """
    known = y.shape[1]
    last = known - 1
    moved = torch.zeros_like(y)
    moved[:, 1:] = y[:, 1:] - y[:, :-1]
    left = driven[:, 1:last] - moved[:, 1:last]
    products = (left * (moved[:, 2:] - moved[:, 1:last])).sum(1)
    squares = left.square().sum(1)
    share = torch.where(squares > 0, (products / squares).clamp(0.01, 1.0), 1.0)

    def path(start: int, count: int) -> Tensor:
        position, step = y[:, start], moved[:, start] if start > 0 else driven[:, 0]
        positions = []
        for sample in range(start, start + count):
            step = step + share * (driven[:, sample] - step)
            position = position + step
            positions.append(position)
        return torch.stack(positions, 1)

    sums, counts = torch.zeros_like(driven[:, :horizon]), torch.zeros(horizon)
    for start in range(1, last, STRIDE):
        count = min(horizon, last - start)
        sums[:, :count] += (path(start, count) - y[:, start + 1 : start + 1 + count]).square()
        counts[:count] += 1
    center = path(last, horizon)
    seen = (sums / counts.clamp(min=1)[None, :, None]).sqrt()
    way = LEAST_ERROR * (center - y[:, last:]).abs()
    error = torch.maximum(seen, way).clamp(min=LEAST_ERROR_RAD)
    return center, error.cummax(1).values

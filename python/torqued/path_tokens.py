"""Tokens of a trajectory beside a path, and positions from velocities relative to that path, as in
`crates/models/src/path_tokens`."""

import math
from abc import abstractmethod

import torch
import torch.nn.functional as F
from torch import Tensor, nn

RISE_S = 0.1
LEAST_ERROR_DEG = 0.01
LEAST_SPEED = 1e-3
DISTANCE_S = 0.5
"""As in `crates/models/src/path_tokens`."""


class PathTokens(nn.Module):
    """A network that reads a trajectory from its first token to its last."""

    is_physical = True

    def __init__(
        self, patch: int, least_context: int | None, residual: dict, context: int, samples: int, rate_hz: float
    ):
        super().__init__()
        [(_, path)] = residual.items()
        self.patch, self.rate_hz = patch, rate_hz
        self.contexts, self.samples = (least_context or context, context), samples
        self.damping = path["damping"]

    @abstractmethod
    def forward(self, tokens: Tensor, known: int) -> Tensor:
        """Velocities relative to the path's [batch, horizon, joint] in units of the trajectory's speed, from tokens
        [batch, token, (patch + 1) * channel]. The first `known` tokens are the context's."""

    def width(self, joints: int) -> int:
        """The width of a token."""
        return (5 * joints + 2) * (self.patch + 1)

    def by_sample(self, velocities: Tensor) -> Tensor:
        """Velocities [batch, sample, joint] of tokens [batch, token, patch * joint]."""
        batch, tokens, width = velocities.shape
        return velocities.reshape(batch, tokens * self.patch, width // self.patch)

    def answers(self, context: int, samples: int) -> bool:
        """Whether it was trained for contexts of `context` samples, and for trajectories of at least `samples`."""
        least, most = self.contexts
        whole = context % self.patch == 0 and samples % self.patch == 0
        ends = context < samples <= self.samples if least < most else samples == self.samples
        return whole and least <= context <= most and ends

    def displacement(self, u: Tensor, y_context: Tensor, path: Tensor) -> Tensor:
        """The displacement of the arm from the path [batch, samples, joint], rad, over the horizon."""
        tokens, speed = self.tokens(u, y_context, path)
        context = y_context.shape[1]
        horizon = u.shape[1] - context
        passed_s = torch.arange(1, horizon + 1, dtype=torch.float64) / self.rate_hz
        rise = (1 - torch.exp(-passed_s / RISE_S)).to(tokens.dtype)[:, None]
        return (self(tokens, context // self.patch) * rise * speed).cumsum(1) / self.rate_hz

    def answer(self, u: Tensor, y_context: Tensor, path: Tensor, unit: Tensor) -> Tensor:
        """The displacement in its unit [batch, samples, joint]."""
        return self.displacement(u, y_context, path) / unit[:, y_context.shape[1] :]

    def loss(self, u: Tensor, y_context: Tensor, y_horizon: Tensor, path: Tensor, unit: Tensor) -> Tensor:
        """The mean over trajectories and joints of the root mean square error over the horizon, degrees."""
        errors = self.displacement(u, y_context, path) - y_horizon * unit[:, y_context.shape[1] :]
        errors = errors * math.degrees(1.0)
        return (errors.square().mean(1) + LEAST_ERROR_DEG**2).sqrt().mean()

    def tokens(self, u: Tensor, y_context: Tensor, path: Tensor) -> tuple[Tensor, Tensor]:
        """Tokens [batch, token, (patch + 1) * channel], and the speed of each trajectory, [batch, 1, 1], rad/s."""
        context = y_context.shape[1]
        angles = torch.cat([y_context, path[:, context:]], 1)
        driven = u / self.damping
        velocities = angles.diff(dim=1) * self.rate_hz
        velocities = torch.cat([velocities[:, :1], velocities], 1)
        distances = F.pad(y_context - path[:, :context], (0, 0, 0, u.shape[1] - context))
        squares = driven.square().mean((1, 2)) + velocities[:, :context].square().mean((1, 2))
        speed = squares.sqrt()[:, None, None] + LEAST_SPEED
        is_future = (torch.arange(u.shape[1]) >= context).to(u.dtype)[None, :, None]
        channels = [driven / speed, velocities / speed, distances / (DISTANCE_S * speed), angles.sin(), angles.cos()]
        channels += [is_future.expand(len(u), -1, -1), speed.log().expand(-1, u.shape[1], -1)]
        samples = F.pad(torch.cat(channels, -1), (0, 0, 1, 0))
        return samples.unfold(1, self.patch + 1, self.patch).mT.flatten(2), speed

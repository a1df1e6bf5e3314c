"""The PyTorch twin of `models/src/lagrangian`: same names, same numbers, in N·m, rad and s."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn

LEAST_INERTIA = 1e-3
"""Added to the diagonal of the mass matrix, kg m²."""
SWEEPS = 3
"""Times that the products of velocities are computed within a sampling time."""
FASTEST = 50.0
"""The fastest that a joint is let turn, rad/s."""
INITIAL_DIAGONAL, INITIAL_HEAD, INITIAL_NOISE, INITIAL_SHARE = 0.3, 0.35, 0.3, 0.75
"""As in `models/src/lagrangian/mod.rs`."""


@dataclass
class Motions:
    """What the law is told of samples, each `[batch, point, joint]`."""

    q: Tensor
    """Angles, rad."""
    velocity: Tensor
    """Mean velocity over the sampling time before, rad/s."""
    change: Tensor
    """By how much the velocity over the sampling time after is more, rad/s."""
    torque: Tensor
    """Torque over the sampling time before, N·m."""
    step: Tensor
    """By how much the torque over the sampling time after is more, N·m."""

    @classmethod
    def of(cls, u: Tensor, y: Tensor, rate_hz: float) -> "Motions":
        """At every sample of y but the first and the last."""
        velocity = rate_hz * y.diff(dim=1)
        u = u[:, : y.shape[1] - 1]
        return cls(y[:, 1:-1], velocity[:, :-1], velocity.diff(dim=1), u[:, :-1], u.diff(dim=1))

    def at(self, points: Tensor) -> "Motions":
        """At the points [batch, point], counted from the first of these."""
        joints = self.q.shape[-1]
        index = points[:, :, None].expand(-1, -1, joints)
        return Motions(*(series.gather(1, index) for series in vars(self).values()))


class Lagrangian(nn.Module):
    """The equations of motion of an arm. The dampings of each robot are fitted to its context."""

    is_physical = True
    """It is given N·m and rad, and answers in rad."""
    pace = 10.0
    """The learned numbers that stand alone are multiplied with this."""

    def __init__(
        self,
        *,
        width: int = 96,
        layers: int = 2,
        points: int = 24,
        turns_freely: bool = True,
        context: int,
        rate_hz: float,
        joints: int = 7,
    ):
        super().__init__()
        self.joints = joints
        self.rate_hz = rate_hz
        self.points = min(points, context - 2)
        self.first = int(turns_freely)
        pairs = joints * (joints + 1) // 2
        inputs = [2 * (joints - self.first)] + [width] * (layers - 1)
        self.hidden = nn.ModuleList(nn.Linear(size, width) for size in inputs)
        self.head = nn.Linear(width, joints * (joints + pairs))
        nn.init.uniform_(self.head.weight, -INITIAL_HEAD / width**0.5, INITIAL_HEAD / width**0.5)
        nn.init.zeros_(self.head.bias)
        self.head.bias.data[: joints * joints : joints + 1] = INITIAL_DIAGONAL
        share = math.log(INITIAL_SHARE / (1 - INITIAL_SHARE))
        self.share = nn.Parameter(torch.full((joints,), share / self.pace))
        self.damping = nn.Parameter(torch.zeros(joints))
        self.damping_spread = nn.Parameter(torch.zeros(joints))
        self.noise = nn.Parameter(torch.full((joints,), math.log(INITIAL_NOISE) / self.pace))

    def answer(self, u: Tensor, y_context: Tensor) -> Tensor:
        """y of the horizon, rad, from u [batch, samples, joint] in N·m and y of the context in rad."""
        context, rate = y_context.shape[1], self.rate_hz
        motions = Motions.of(u, y_context, rate)
        damping, _ = self.fit(motions, self.inertial(motions))
        share = self._share()
        q = y_context[:, -1]
        velocity = rate * (q - y_context[:, -2])
        answer = []
        for sample in range(context - 1, u.shape[1] - 1):
            factor, coefficients = self.numbers(q)
            matrix = rate * (factor @ factor.mT + LEAST_INERTIA * torch.eye(self.joints).to(q))
            lower = torch.linalg.cholesky(matrix + torch.diag_embed(share * damping))
            torque = u[:, sample - 1] + share * (u[:, sample] - u[:, sample - 1])
            driving = torque - damping * velocity
            change = torch.zeros_like(velocity)
            for _ in range(SWEEPS):
                coriolis = _times(coefficients, _products(velocity + 0.5 * change))
                change = torch.cholesky_solve((driving - coriolis)[..., None], lower)[..., 0]
                change = (velocity + change).clamp(-FASTEST, FASTEST) - velocity
            velocity = velocity + change
            q = q + velocity / rate
            answer.append(q)
        return torch.stack(answer, 1)

    def loss(self, u: Tensor, y_context: Tensor, y_horizon: Tensor) -> Tensor:
        """The mean negative logarithm of the likelihood of torques in N·m, less a constant.

        It looks at `points` samples of each context, at equal distances, from one that PyTorch draws.
        Nothing of the horizon is looked at.
        """
        batch, context, _ = y_context.shape
        stride = (context - 2) // self.points
        offsets = torch.randint(stride, (batch, 1), device=u.device)
        points = offsets + stride * torch.arange(self.points, device=u.device)
        motions = Motions.of(u, y_context, self.rate_hz).at(points)
        inertial = self.inertial(motions)
        # The likelihood does not change with the fitted dampings to first order.
        damping, squares = (fitted.detach()[:, None] for fitted in self.fit(motions, inertial))
        residual = inertial + damping * motions.velocity - motions.torque
        residual = residual + self._share() * (damping * motions.change - motions.step)
        log_noise, log_spread = self.pace * self.noise, self.pace * self.damping_spread
        precision, spread_precision = (-2 * log_noise).exp(), (-2 * log_spread).exp()
        unlikely = 0.5 * (damping - (self.pace * self.damping).exp()).square() * spread_precision
        narrow = 0.5 * (squares * precision + spread_precision).log()
        of_dampings = (unlikely + log_spread + narrow) / self.points
        return (0.5 * residual.square() * precision + log_noise + of_dampings).mean()

    def numbers(self, q: Tensor) -> tuple[Tensor, Tensor]:
        """The factor A [.., joint, joint] of the mass matrix A Aᵀ + ε and the coefficients C
        [.., joint, product] of the products of velocities, at the angles q [.., joint]."""
        seen = q[..., self.first :]
        x = torch.cat([seen.sin(), seen.cos()], -1)
        for layer in self.hidden:
            x = layer(x).tanh()
        numbers, squares = self.head(x), self.joints**2
        factor, coefficients = numbers[..., :squares], numbers[..., squares:]
        return factor.unflatten(-1, (self.joints, -1)), coefficients.unflatten(-1, (self.joints, -1))

    def inertial(self, motions: Motions) -> Tensor:
        """The torques that inertia takes, N·m, [batch, point, joint]."""
        factor, coefficients = self.numbers(motions.q)
        acceleration = self.rate_hz * motions.change
        inertia = _times(factor, _times(factor.mT, acceleration)) + LEAST_INERTIA * acceleration
        return inertia + _times(coefficients, _products(motions.velocity + 0.5 * motions.change))

    def fit(self, motions: Motions, inertial: Tensor) -> tuple[Tensor, Tensor]:
        """The most likely damping of each joint, N·m·s/rad and 0 at least, and the sum of the squared
        velocities that tell it, each [batch, joint]."""
        share = self._share()
        velocity = (motions.velocity + share * motions.change).double()
        torque = motions.torque + share * motions.step
        squares = velocity.square().sum(1)
        products = (velocity * (torque - inertial)).sum(1)
        mean = (self.pace * self.damping).exp()
        weight = (2 * self.pace * (self.noise - self.damping_spread)).exp().double()
        damping = ((weight * mean + products) / (weight + squares)).clamp(min=0)
        return damping.to(inertial.dtype), squares.to(inertial.dtype)

    def _share(self) -> Tensor:
        """How far torque and velocity lie towards the newer of two values, [joint]."""
        return (self.pace * self.share).sigmoid()


def _times(matrix: Tensor, vector: Tensor) -> Tensor:
    return (matrix @ vector[..., None])[..., 0]


def _products(velocity: Tensor) -> Tensor:
    """Products of two velocities, each pair once: (0, 0), (0, 1), .., (1, 1), ..."""
    first, second = torch.triu_indices(velocity.shape[-1], velocity.shape[-1])
    return velocity[..., first] * velocity[..., second]


TWINS = {"lagrangian": Lagrangian}

"""The `lagrangian` with one of its parts taken away."""

import torch
from torch import Tensor, nn

from torqued.lagrangian import (
    DIRECTIONS,
    FASTEST,
    INITIAL_ARMATURE,
    INITIAL_HEAD,
    INITIAL_NOISE,
    INITIAL_SHARED_SPREAD,
    SWEEPS,
    Fit,
    Lagrangian,
    Motions,
)

NEGATIVE = 2
"""The direction of each particle whose squared velocity counts negative."""


class MassesHeldAtZero(Lagrangian):
    """Trained like the complete model. Its predictions hold masses that would come out negative at 0, as they
    do dampings and frictions."""

    def is_solid(self, y: Tensor, numbers: Tensor) -> Tensor:
        return (numbers[:, : self.counts[0]] >= 0).all(-1)


class NoPositiveDefiniteness(Lagrangian):
    """The mass matrix is Σ w B S Bᵀ + J with S = diag(1, 1, -1), any sign of w and any sign of J.

    Any symmetric matrix is the difference of two positive semidefinite ones. The law stays one of forces
    w B S (Bᵀ a + Ḃᵀ v̄), in whose products of velocities no energy appears or is lost.
    """

    def __init__(self, **sizes):
        super().__init__(**sizes)
        nn.init.constant_(self.armature, INITIAL_ARMATURE)

    def equations(self, motions: Motions) -> tuple[Tensor, Tensor]:
        share = self._share()
        acceleration = self.rate_hz * motions.change
        jacobian, carried, forces = self.pose(motions.q, motions.velocity + 0.5 * motions.change)
        accelerated = times(jacobian, acceleration) + carried
        particles = sum((signed(jacobian) * accelerated[..., None]).chunk(DIRECTIONS, -2)).mT
        velocity = motions.velocity + share * motions.change
        own = [torch.diag_embed(velocity), torch.diag_embed(self.friction_of(velocity)[0])]
        columns = [particles, forces[..., 1:, :].mT, *own, forces[..., :1, :].mT]
        torque = motions.torque + share * motions.step
        return torch.cat(columns, -1), torque - self.armature * acceleration

    def is_solid(self, y: Tensor, numbers: Tensor) -> Tensor:
        return torch.ones(len(numbers), dtype=torch.bool)

    def roll(self, u: Tensor, y: Tensor, numbers: Tensor) -> tuple[Tensor, Tensor]:
        """As the complete model's, with S, and with LU in place of L D Lᵀ: no pivot is raised."""
        rate, share = self.rate_hz, self._share()
        weights, strengths, damping, friction = numbers.split(self.counts, -1)
        q = y[:, 1]
        velocity = rate * (q - y[:, 0])
        change = torch.zeros_like(velocity)
        answer = []
        for sample in range(1, u.shape[1] - 1):
            jacobian, carried, forces = self.pose(q, velocity + 0.5 * change)
            weighted = weights.repeat(1, DIRECTIONS)[:, :, None] * signed(jacobian)
            bias = times(weighted.mT, carried) + forces[:, 0] + times(forces[:, 1:].mT, strengths)
            torque = u[:, sample - 1] + share * (u[:, sample] - u[:, sample - 1])
            driving = torque - damping * velocity - bias
            inertia = rate * weighted.mT @ jacobian + torch.diag_embed(rate * self.armature + share * damping)
            for _ in range(SWEEPS):
                shape, slope = self.friction_of(velocity + share * change)
                shape, slope = friction * shape, friction * slope
                right = driving - shape + slope * share * change
                change = torch.linalg.solve(inertia + torch.diag_embed(share * slope), right)
                change = (velocity + change).clamp(-FASTEST, FASTEST) - velocity
            velocity = velocity + change
            q = q + velocity / rate
            answer.append(q)
        return torch.stack(answer, 1), torch.ones(len(u), dtype=torch.bool)


class NoQuadraticTerms(Lagrangian):
    """No torque has products of velocities: Ḃᵀ v̄ is left out."""

    def pose(self, q: Tensor, velocity: Tensor) -> tuple[Tensor, Tensor, Tensor | None]:
        jacobian, carried, forces = super().pose(q, velocity)
        return jacobian, torch.zeros_like(carried), forces


class NoFit(Lagrangian):
    """Every robot has the numbers that are the mean over robots, which are learned."""

    def __init__(self, **sizes):
        super().__init__(**sizes)
        self.spread.requires_grad_(False)

    def posterior(
        self, factors: Tensor, torque: Tensor, weight: float, noise: Tensor, held: Tensor | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """The means, known exactly: the same torques follow from them for every robot."""
        with torch.enable_grad():
            mean = self._means().expand(len(factors), -1)
        width = mean.shape[-1]
        return mean, factors.new_zeros(len(factors), width, width), factors.new_zeros(len(factors))

    def fits(self, u: Tensor, y: Tensor) -> list[Fit]:
        numbers = self._means().expand(len(u), -1)
        return [(numbers, torch.diag_embed(torch.zeros_like(numbers)), numbers < 0)] * 2


class NoStructure(Lagrangian):
    """A network of angles, velocities and torques gives the next change of the velocities.

    The change is N_0 + Σ z_k N_k + a v + b u, all N of one network and a, b of each joint. A robot's
    numbers z, a and b are fitted by the regression of the complete model and are as many. There is no mass matrix.
    Velocities, torques and changes are in units of their standard deviation over the training set.
    """

    def __init__(
        self,
        *,
        width: int = 96,
        layers: int = 2,
        points: int = 24,
        terms: int = 24,
        own: bool = True,
        context: int,
        rate_hz: float,
        joints: int = 7,
    ):
        nn.Module.__init__(self)
        self.joints = joints
        self.rate_hz = rate_hz
        self.points = min(points, context - 2)
        self.first = 1
        self.own = own
        self.counts = [terms, 2 * joints if own else 0]
        for name in ("velocity", "change", "torque"):
            self.register_buffer(f"{name}_unit", torch.ones(joints))
        inputs = [2 * (joints - self.first) + 3 * joints] + [width] * (layers - 1)
        self.hidden = nn.ModuleList(nn.Linear(size, width) for size in inputs)
        for layer in self.hidden:
            nn.init.xavier_uniform_(layer.weight)
            nn.init.zeros_(layer.bias)
        self.terms = nn.Linear(width, (1 + terms) * joints)
        nn.init.uniform_(self.terms.weight, -INITIAL_HEAD / width**0.5, INITIAL_HEAD / width**0.5)
        nn.init.zeros_(self.terms.bias)
        self.mean = nn.Parameter(torch.zeros(self.counts[1]))
        self.spread = nn.Parameter(torch.full((sum(self.counts),), INITIAL_SHARED_SPREAD).log() / self.pace)
        self.noise = nn.Parameter(torch.full((joints,), INITIAL_NOISE).log() / self.pace)
        self.doubt = nn.Parameter(torch.zeros(3))

    def measure(self, recorded: Motions) -> None:
        """Takes the units of velocities, changes and torques from the training set."""
        for name in ("velocity", "change", "torque"):
            setattr(self, f"{name}_unit", getattr(recorded, name).std((0, 1)))

    def _means(self) -> Tensor:
        return torch.cat([self.mean.new_zeros(self.counts[0]), self.pace * self.mean])

    def factors(self, q: Tensor, velocity: Tensor, before: Tensor, after: Tensor) -> Tensor:
        """The factor of each number and N_0, [.., joint, number + 1]."""
        seen = q[..., self.first :]
        velocity, before, after = velocity / self.velocity_unit, before / self.torque_unit, after / self.torque_unit
        x = torch.cat([seen.sin(), seen.cos(), velocity, before, after], -1)
        for layer in self.hidden:
            x = layer(x).tanh()
        terms = self.terms(x).unflatten(-1, (-1, self.joints)).mT
        own = [torch.diag_embed(velocity), torch.diag_embed(after)] if self.own else []
        return torch.cat([terms[..., 1:], *own, terms[..., :1]], -1)

    def equations(self, motions: Motions) -> tuple[Tensor, Tensor]:
        after = motions.torque + motions.step
        factors = self.factors(motions.q, motions.velocity, motions.torque, after)
        return factors, motions.change / self.change_unit

    def is_solid(self, y: Tensor, numbers: Tensor) -> Tensor:
        return torch.ones(len(numbers), dtype=torch.bool)

    def roll(self, u: Tensor, y: Tensor, numbers: Tensor) -> tuple[Tensor, Tensor]:
        combination = torch.cat([numbers, torch.ones_like(numbers[:, :1])], -1)
        q = y[:, 1]
        velocity = self.rate_hz * (q - y[:, 0])
        answer = []
        for sample in range(1, u.shape[1] - 1):
            change = times(self.factors(q, velocity, u[:, sample - 1], u[:, sample]), combination)
            velocity = (velocity + self.change_unit * change).clamp(-FASTEST, FASTEST)
            q = q + velocity / self.rate_hz
            answer.append(q)
        return torch.stack(answer, 1), torch.ones(len(u), dtype=torch.bool)


def shares(model: Lagrangian, u: Tensor, y: Tensor, context: int) -> tuple[float, float]:
    """The share of robots with a negative mass, and of those whose mass matrix has a negative eigenvalue at some
    sample of y before any pivot is raised."""
    masses = model.fits(u, y[:, :context])[0][0][:, : model.counts[0]]
    weights = masses.repeat(1, DIRECTIONS)[:, :, None]
    indefinite_metric = isinstance(model, NoPositiveDefiniteness)
    armature = model.armature if indefinite_metric else (model.pace * model.armature).exp()
    indefinite = torch.zeros(len(y), dtype=torch.bool)
    for q in y.unbind(1):
        jacobian, _, _ = model.pose(q, torch.zeros_like(q))
        weighted = weights * (signed(jacobian) if indefinite_metric else jacobian)
        mass = weighted.mT @ jacobian + torch.diag_embed(armature)
        indefinite |= torch.linalg.eigvalsh(mass.double()).min(-1).values < 0
    return (masses < 0).any(-1).double().mean().item(), indefinite.double().mean().item()


def signed(jacobian: Tensor) -> Tensor:
    """S Bᵀ of the Jacobians Bᵀ [.., direction · particle, joint]."""
    parts = list(jacobian.chunk(DIRECTIONS, -2))
    parts[NEGATIVE] = -parts[NEGATIVE]
    return torch.cat(parts, -2)


def times(matrix: Tensor, vector: Tensor) -> Tensor:
    return (matrix @ vector[..., None])[..., 0]

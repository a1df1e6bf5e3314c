"""The PyTorch twin of `crates/models/src/lagrangian`: same names, same numbers, in N·m, rad and s."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn

SWEEPS = 2
"""Number of linearizations of friction within a sampling time."""
FASTEST = 50.0
"""The largest joint speed, rad/s."""
ROUNDS = 8
"""Rounds in which dampings and frictions below 0 are held at 0 and the other numbers are fitted again."""
FORCE_UNIT = 10.0
"""The unit of learned forces, N·m."""
LEAST_SHARE = 0.5
"""The least share of the newer value. With less, the steps of a joint without inertia would oscillate with growing
amplitude."""
DIRECTIONS = 3
"""Directions in which a particle can move."""
INITIAL_JACOBIAN, INITIAL_HEAD, INITIAL_ARMATURE, INITIAL_NOISE = 0.9, 0.35, 0.1, 0.3
INITIAL_SLOPE = 4.0
INITIAL_SHARED_SPREAD, INITIAL_DAMPING_SPREAD, INITIAL_FRICTION_SPREAD = 0.1, 1.0, 0.1
INITIAL_SCALE_SPREAD = 0.3
"""As in `crates/models/src/lagrangian/mod.rs`."""
NOISE_ROUNDS = 3
"""Rounds in which the noise of a context is estimated again from the residuals of the last fit."""
EVERY = 8
"""The stride of a context's samples where only poses matter."""
LEAST_PIVOT = 0.99
"""Least pivot of a mass matrix, as a ratio to the inertia of the joint alone."""
HALVINGS = 6
"""How often a draw is moved half-way to the most likely robot, until its pivots are large enough."""
DRAWS = 7
"""Draws per robot whose score is part of the loss."""
SCORED = 12
"""One robot of so many is scored where `points` are more."""
LEAST_DIFFERENCE = 1e-6
"""The least unit of the score, rad."""
CALIBRATION_PACE = 30.0
"""The scales of draws learn faster than weights by this factor."""
PARTS = 4
"""Parts of a context. Each is left out in turn for its residual torques."""
STRETCH = 3
"""Number of normal numbers that choose the stretch of residual torques of a draw."""


Fit = tuple[Tensor, Tensor, Tensor]
"""The most likely numbers of each robot [batch, number], a root of their covariance [batch, number, number], and a
mask of the numbers that must be at least 0 [batch, number]."""


@dataclass
class Motions:
    """The motion at samples, in the form that the equations need. Each field is `[batch, point, joint]`."""

    q: Tensor
    """Angles, rad."""
    velocity: Tensor
    """Mean velocity over the sampling time before the sample, rad/s."""
    change: Tensor
    """Increase of the mean velocity over the sampling time after the sample, rad/s."""
    torque: Tensor
    """Torque over the sampling time before the sample, N·m."""
    step: Tensor
    """Increase of the torque over the sampling time after the sample, N·m."""

    @classmethod
    def of(cls, u: Tensor, y: Tensor, rate_hz: float) -> "Motions":
        """The motion at every sample of y except the first and the last."""
        velocity = rate_hz * y.diff(dim=1)
        u = u[:, : y.shape[1] - 1]
        return cls(y[:, 1:-1], velocity[:, :-1], velocity.diff(dim=1), u[:, :-1], u.diff(dim=1))

    def at(self, points: Tensor) -> "Motions":
        """The motion at the points [batch, point], counted from the first of these samples."""
        joints = self.q.shape[-1]
        index = points[:, :, None].expand(-1, -1, joints)
        return Motions(*(series.gather(1, index) for series in vars(self).values()))


class Lagrangian(nn.Module):
    """The equations of motion of an arm. Masses, forces, damping and friction of each robot are fitted to its
    context."""

    is_physical = True
    """Inputs are in N·m and rad, and answers in rad."""
    pace = 10.0
    """The factor of the scalar parameters."""
    LACKS = ("robot", "chain", "rotor_inertia", "torque_offset", "disturbance")
    """Fields of torqued's model that this one lacks."""

    def __init__(
        self,
        *,
        width: int = 96,
        layers: int = 2,
        points: int = 24,
        particles: int = 12,
        forces: int = 12,
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
        self.counts = [particles, forces, joints, joints]
        inputs = [2 * (joints - self.first)] + [width] * (layers - 1)
        self.hidden = nn.ModuleList(nn.Linear(size, width) for size in inputs)
        self.particles = nn.Linear(width, DIRECTIONS * particles * joints)
        self.forces = nn.Linear(width, (1 + forces) * joints) if forces else None
        for layer in self.hidden:
            nn.init.xavier_uniform_(layer.weight)
            nn.init.zeros_(layer.bias)
        for head in filter(None, [self.particles, self.forces]):
            nn.init.uniform_(head.weight, -INITIAL_HEAD / width**0.5, INITIAL_HEAD / width**0.5)
            nn.init.zeros_(head.bias)
        bound = INITIAL_JACOBIAN / (DIRECTIONS * particles) ** 0.5
        nn.init.uniform_(self.particles.bias, -bound, bound)

        def of_joints(value: float) -> nn.Parameter:
            return nn.Parameter(torch.full((joints,), value / self.pace))

        self.share = of_joints(0.0)
        self.armature = of_joints(math.log(INITIAL_ARMATURE))
        self.damping = of_joints(0.0)
        self.friction = of_joints(0.0)
        self.friction_slope = of_joints(math.log(INITIAL_SLOPE))
        self.friction_shift = of_joints(0.0)
        shared = [INITIAL_SHARED_SPREAD] * (particles + forces)
        spread = shared + [INITIAL_DAMPING_SPREAD] * joints + [INITIAL_FRICTION_SPREAD] * joints
        self.spread = nn.Parameter(torch.tensor(spread).log() / self.pace)
        self.noise = of_joints(math.log(INITIAL_NOISE))
        self.doubt = nn.Parameter(torch.tensor([0.0, INITIAL_SCALE_SPREAD / CALIBRATION_PACE, 0.0]))

    def answers(self, context: int, samples: int) -> bool:
        """Whether it can predict from a context of this length. The equations fit every length."""
        return 3 <= context < samples

    def answer(self, u: Tensor, y_context: Tensor) -> Tensor:
        """y of the horizon, rad, from u [batch, samples, joint] in N·m and y of the context in rad."""
        before = y_context.shape[1] - 2
        return self.roll_out(u[:, before:], y_context[:, before:], [fit[0] for fit in self.fits(u, y_context)])

    def draws(self, u: Tensor, y_context: Tensor, count: int) -> Tensor:
        """y of the horizon, rad, [draw, batch, horizon, joint], for robots that the context allows.

        torqued draws other numbers.
        """
        fits = self.fits(u, y_context)
        residuals = self.residual_torques(u, y_context, fits)
        before, answers = y_context.shape[1] - 2, []
        ahead, start = u[:, before:], y_context[:, before:]
        log_median, log_spread, log_torque = CALIBRATION_PACE * self.doubt
        for _ in range(count):
            scale = (log_median + log_spread * torch.randn(len(u), 1).to(u)).exp()
            normal, stretch = torch.randn_like(fits[0][0]), torch.randn(len(u), STRETCH).to(u)
            drawn = [self.draw_numbers(y_context, fit, scale, normal) for fit in fits]
            more = [(scale * log_torque.exp())[..., None] * _stretch(each, stretch, ahead) for each in residuals]
            answers.append(self.roll_out([ahead + torques for torques in more], start, drawn))
        return torch.stack(answers)

    def residual_torques(self, u: Tensor, y: Tensor, fits: list[Fit]) -> list[Tensor]:
        """The residual torques of robots within the bounds of each of `fits` over the context y, [batch, sample,
        joint], N·m. Those of each of the PARTS come from a robot that was fitted to the others."""
        factors, torque = self.equations(Motions.of(u, y, self.rate_hz))
        samples = factors.shape[1]
        weight = min(self.points / samples, 1.0)
        ends = [part * samples // PARTS for part in range(PARTS + 1)]
        parts = list(zip(ends[:-1], ends[1:]))

        def of_part(first: int, end: int, bounded: Tensor) -> Tensor:
            seen = [torch.cat([a[:, :first], a[:, end:]], 1) for a in (factors, torque)]
            numbers, _ = self._fit(*seen, weight, bounded)
            return _residuals(factors[:, first:end], torque[:, first:end], numbers)

        return [torch.cat([of_part(*part, bounded) for part in parts], 1).to(u) for _, _, bounded in fits]

    def roll_out(self, u: Tensor | list[Tensor], y: Tensor, robots: list[Tensor]) -> Tensor:
        """Positions after the first two, y [batch, 2, joint]. They are those of the first of `robots` [batch,
        number], or of the second if some pose on the way gives the first too little inertia. Each robot may have
        its own torques."""
        free, masses = robots
        of_free, of_masses = u if isinstance(u, list) else (u, u)
        answer, solid = self.roll(of_free, y, free)
        if solid.all():
            return answer
        return torch.where(solid[:, None, None], answer, self.roll(of_masses, y, masses)[0])

    def roll(self, u: Tensor, y: Tensor, numbers: Tensor) -> tuple[Tensor, Tensor]:
        """Positions after the first two, y [batch, 2, joint], of robots with these numbers, and whether each has
        enough inertia in all poses on the way [batch]."""
        rate = self.rate_hz
        weights, strengths, damping, friction = numbers.split(self.counts, -1)
        share = self._share()
        armature = (self.pace * self.armature).exp()
        q = y[:, 1]
        velocity = rate * (q - y[:, 0])
        change = torch.zeros_like(velocity)
        answer, solid = [], torch.ones(len(u), dtype=torch.bool, device=u.device)
        for sample in range(1, u.shape[1] - 1):
            jacobian, carried, forces = self.pose(q, velocity + 0.5 * change)
            weighted = weights.repeat(1, DIRECTIONS)[:, :, None] * jacobian
            bias = _times(weighted.mT, carried)
            if forces is not None:
                bias = bias + forces[:, 0] + _times(forces[:, 1:].mT, strengths)
            torque = u[:, sample - 1] + share * (u[:, sample] - u[:, sample - 1])
            driving = torque - damping * velocity - bias
            inertia = weighted.mT @ jacobian + torch.diag_embed(armature.expand_as(damping))
            solid = solid & _is_solid(inertia, armature)
            inertia = rate * inertia + torch.diag_embed(share * damping)
            for _ in range(SWEEPS):
                shape, slope = self.friction_of(velocity + share * change)
                shape, slope = friction * shape, friction * slope
                matrix = inertia + torch.diag_embed(share * slope)
                right = driving - shape + slope * share * change
                change = _solved(matrix, right, rate * armature)
                change = (velocity + change).clamp(-FASTEST, FASTEST) - velocity
            velocity = velocity + change
            q = q + velocity / rate
            answer.append(q)
        return torch.stack(answer, 1), solid

    def loss(
        self,
        u: Tensor,
        y_context: Tensor,
        y_horizon: Tensor,
        chosen: Tensor | None = None,
        normals: Tensor | None = None,
    ) -> Tensor:
        """The mean negative log-likelihood of torques in N·m, up to a constant, plus the score of draws.

        The likelihood uses `points` samples of each context, at equal distances, with a first one that PyTorch
        draws. Only the score uses the horizon. It scores draws of the robots `chosen` [batch], by default one in
        `points` or in SCORED, with the normal numbers `normals` [batch, draw, number + 1 + STRETCH].
        """
        if chosen is None:
            chosen = torch.rand(len(u), device=u.device) < 1 / min(self.points, SCORED)
        if normals is None:
            normals = torch.randn(len(u), DRAWS, sum(self.counts) + 1 + STRETCH).to(u)
        batch, context, _ = y_context.shape
        stride = (context - 2) // self.points
        offsets = torch.randint(stride, (batch, 1), device=u.device)
        points = offsets + stride * torch.arange(self.points, device=u.device)
        factors, torque = self.equations(Motions.of(u, y_context, self.rate_hz).at(points))
        # The distribution of the numbers is given. Its change does not change the likelihood to
        # first order.
        with torch.no_grad():
            noise = (self.pace * self.noise).exp().expand(batch, -1)
            mean, root, gain = self.posterior(factors, torque, 1.0, noise)
        own, common = factors[..., :-1], factors[..., -1]
        rows = torque.shape[1] * torque.shape[2]
        off = (_times(own, mean[:, None]) + common - torque).square()
        uncertainty = (own @ root[:, None]).square().sum(-1)
        log_noise, log_spread = self.pace * self.noise, self.pace * self.spread
        squares = (mean - self._means()).square() + root.square().sum(-1)
        unlikely = (0.5 * squares * (-2 * log_spread).exp() + log_spread).sum(-1)
        divergence = unlikely + gain - (log_spread.detach().sum() + 0.5 * mean.shape[-1])
        of_torques = 0.5 * (off + uncertainty) * (-2 * log_noise).exp() + log_noise
        likelihood = (of_torques + divergence[:, None, None] / rows).mean()
        if not chosen.any():
            return likelihood + 0.0 * self.doubt.sum()
        score = self.score(u[chosen], y_context[chosen], y_horizon[chosen], normals[chosen])
        return likelihood + score.mean() * chosen.sum() * min(self.points, SCORED) / batch

    def score(self, u: Tensor, y_context: Tensor, y_horizon: Tensor, normals: Tensor) -> Tensor:
        """The fair continuous ranked probability score of draws, in units of their spread before scaling, [batch,
        horizon - 2, joint]. Only `doubt` has a gradient."""
        context, count = y_context.shape[1], sum(self.counts)
        with torch.no_grad():
            fits = self.fits(u, y_context)
            residuals = self.residual_torques(u, y_context, fits)
            u = u[:, context:]
            start, ahead = y_horizon[:, :2], y_horizon[:, 2:]
            likely = [numbers for numbers, _, _ in fits]
            mean = self.roll_out(u, start, likely)
            one = torch.ones_like(u[:, 0, :1])
            of_numbers, of_torques = [], []
            for normal in normals.unbind(1):
                drawn = [self.draw_numbers(y_context, fit, one, normal[:, :count]) for fit in fits]
                of_numbers.append(self.roll_out(u, start, drawn) - mean)
                more = [_stretch(each, normal[:, count + 1 :], u) for each in residuals]
                of_torques.append(self.roll_out([u + torques for torques in more], start, likely) - mean)
            of_numbers, of_torques = torch.stack(of_numbers, 1), torch.stack(of_torques, 1)
            unit = (of_numbers.square() + of_torques.square()).mean(1).sqrt().clamp(min=LEAST_DIFFERENCE)
            of_numbers, of_torques = of_numbers / unit[:, None], of_torques / unit[:, None]
            error = (ahead - mean) / unit
        log_median, log_spread, log_torque = CALIBRATION_PACE * self.doubt
        scale = (log_median + log_spread * normals[..., count])[:, :, None, None].exp()
        samples = scale * (of_numbers + log_torque.exp() * of_torques)
        between = (samples[:, :, None] - samples[:, None]).abs().sum((1, 2))
        return (samples - error[:, None]).abs().mean(1) - between / (2 * DRAWS * (DRAWS - 1))

    def draw_numbers(self, y: Tensor, fitted: Fit, scale: Tensor, normal: Tensor) -> Tensor:
        """Numbers at a distance of `scale` [batch, 1] standard deviations from those that were fitted to the
        context y. The distance is halved while some pose of the context would have too little inertia."""
        numbers, root, bounded = fitted
        deviation, found, done = _times(root, normal), numbers, torch.zeros_like(bounded[:, 0])
        for _ in range(HALVINGS):
            drawn = _at_least_0(numbers + scale * deviation, bounded)
            found = torch.where(done[:, None], found, drawn)
            done = done | self.has_enough_inertia(y, found)
            scale = 0.5 * scale
        return torch.where(done[:, None], found, numbers)

    def fits(self, u: Tensor, y: Tensor) -> list[Fit]:
        """The most likely robots of their contexts, and the same with no mass below 0. The first have masses of any
        sign, unless some pose of the context would have too little inertia. Then they equal the second."""
        factors, torque = self.equations(Motions.of(u, y, self.rate_hz))
        weight = min(self.points / factors.shape[1], 1.0)
        particles, forces, *_ = self.counts
        own = torch.ones(len(u), sum(self.counts), dtype=torch.bool, device=u.device)
        own[:, : particles + forces] = False
        with_masses = own.clone()
        with_masses[:, :particles] = True
        free, masses = (
            (*(found.to(u) for found in self._fit(factors, torque, weight, bounded)), bounded)
            for bounded in (own, with_masses)
        )
        solid = self.has_enough_inertia(y, free[0])
        chosen = [torch.where(solid.reshape(-1, *[1] * (a.dim() - 1)), a, b) for a, b in zip(free, masses)]
        return [tuple(chosen), masses]

    def _fit(self, factors: Tensor, torque: Tensor, weight: float, bounded: Tensor) -> tuple[Tensor, Tensor]:
        """Fits the numbers. The noise of a joint is raised to its residual torque where that exceeds the noise of
        training."""
        least = (self.pace * self.noise).exp().expand(len(factors), -1)
        numbers, root = self.most_likely(factors, torque, weight, least, bounded)
        for _ in range(NOISE_ROUNDS):
            squares = _residuals(factors, torque, numbers).square().sum(1)
            residuals = (squares / max(factors.shape[1], 1)).sqrt()
            noise = torch.maximum(least.double(), residuals)
            numbers, root = self.most_likely(factors, torque, weight, noise, bounded)
        return numbers, root

    def has_enough_inertia(self, y: Tensor, numbers: Tensor) -> Tensor:
        """Whether each arm has enough inertia in the poses of its context [batch]."""
        q, armature = y[:, ::EVERY], (self.pace * self.armature).exp()
        jacobian, _, _ = self.pose(q, torch.zeros_like(q))
        weights = numbers[:, : self.counts[0]].repeat(1, DIRECTIONS)[:, None, :, None]
        inertia = (weights * jacobian).mT @ jacobian + torch.diag_embed(armature.expand_as(q))
        return _is_solid(inertia, armature).all(1)

    def pose(self, q: Tensor, velocity: Tensor) -> tuple[Tensor, Tensor, Tensor | None]:
        """Jacobians [.., direction · particle, joint] at the angles q [.., joint], the acceleration of each
        particle at constant joint velocities, and forces [.., 1 + force, joint] in N·m."""
        seen, rate = q[..., self.first :], velocity[..., self.first :]
        x = torch.cat([seen.sin(), seen.cos()], -1)
        moving = torch.cat([seen.cos() * rate, -seen.sin() * rate], -1)
        for layer in self.hidden:
            x = layer(x).tanh()
            moving = (moving @ layer.weight.mT) * (1 - x.square())
        shape = (-1, self.joints)
        jacobian = self.particles(x).unflatten(-1, shape)
        carried = _times((moving @ self.particles.weight.mT).unflatten(-1, shape), velocity)
        if self.first:
            # The frame turns with the first joint about the third axis.
            along_x, along_y, _ = _times(jacobian, velocity).chunk(DIRECTIONS, -1)
            turned = torch.cat([-along_y, along_x, torch.zeros_like(along_x)], -1)
            carried = carried + velocity[..., :1] * turned
        forces = None if self.forces is None else FORCE_UNIT * self.forces(x).unflatten(-1, shape)
        return jacobian, carried, forces

    def equations(self, motions: Motions) -> tuple[Tensor, Tensor]:
        """The factor of each number and that of the force that acts on every robot, [batch, point, joint, number +
        1], and the torques on the right-hand side, N·m, [batch, point, joint]."""
        share = self._share()
        acceleration = self.rate_hz * motions.change
        jacobian, carried, forces = self.pose(motions.q, motions.velocity + 0.5 * motions.change)
        accelerated = _times(jacobian, acceleration) + carried
        particles = sum((jacobian * accelerated[..., None]).chunk(DIRECTIONS, -2)).mT
        velocity = motions.velocity + share * motions.change
        own = [torch.diag_embed(velocity), torch.diag_embed(self.friction_of(velocity)[0])]
        if forces is None:
            columns = [particles, *own, torch.zeros_like(particles[..., :1])]
        else:
            columns = [particles, forces[..., 1:, :].mT, *own, forces[..., :1, :].mT]
        torque = motions.torque + share * motions.step
        return torch.cat(columns, -1), torque - (self.pace * self.armature).exp() * acceleration

    def posterior(
        self, factors: Tensor, torque: Tensor, weight: float, noise: Tensor, held: Tensor | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """The normal distribution of each robot's numbers: the mean [batch, number], a root of the covariance
        [batch, number, number], and the information gain over the prior. `noise` [batch, joint] is that of torques,
        N·m. Numbers that are `held` [batch, number] are 0."""
        precision = noise.double() ** -2
        own, common = factors[..., :-1].double(), factors[..., -1].double()
        spread, mean = (self.pace * self.spread).exp().double(), self._means().double()
        spread = spread.expand(len(own), -1) if held is None else spread * ~held
        scaled = own * spread[:, None, None]
        squares = weight * torch.einsum("bpjn,bj,bpjm->bnm", scaled, precision, scaled)
        right = weight * torch.einsum("bpjn,bj,bpj->bn", scaled, precision, torque.double() - common)
        lower = torch.linalg.cholesky(squares + torch.eye(squares.shape[-1]).to(squares))
        right = right + (spread > 0) * mean / (self.pace * self.spread).exp().double()
        found = spread * torch.cholesky_solve(right[..., None], lower)[..., 0]
        one = torch.eye(squares.shape[-1]).to(squares).expand_as(squares)
        root = spread[..., None] * torch.linalg.solve_triangular(lower.mT, one, upper=True)
        gain = lower.diagonal(dim1=-2, dim2=-1).log().sum(-1)
        return found.to(factors), root.to(factors), gain.to(factors)

    def most_likely(
        self, factors: Tensor, torque: Tensor, weight: float, noise: Tensor, bounded: Tensor
    ) -> tuple[Tensor, Tensor]:
        """The most likely numbers of each robot [batch, number], in double precision, and a root of their
        covariance. Those that are `bounded` [batch, number] are at least 0."""
        factors, torque = factors.double(), torque.double()
        held = torch.zeros(len(factors), sum(self.counts), dtype=torch.bool, device=factors.device)
        for _ in range(ROUNDS):
            found, root, _ = self.posterior(factors, torque, weight, noise, held)
            below = bounded & (found < 0)
            if not below.any():
                break
            held = held | below
        return _at_least_0(found, bounded), root

    def friction_of(self, velocity: Tensor) -> tuple[Tensor, Tensor]:
        """Friction of strength 1 at a velocity in rad/s, and its slope."""
        slope = (self.pace * self.friction_slope).exp()
        value = ((velocity + self.friction_shift) * slope).tanh()
        return value - (slope * self.friction_shift).tanh(), slope * (1 - value.square())

    def _means(self) -> Tensor:
        """The mean of each number over robots."""
        particles, forces, *_ = self.counts
        shared = [self.damping.new_ones(particles), self.damping.new_zeros(forces)]
        return torch.cat([*shared, (self.pace * self.damping).exp(), self.pace * self.friction])

    def _share(self) -> Tensor:
        """The share of the newer one in the torque and the velocity between two values, [joint]."""
        return LEAST_SHARE + (1 - LEAST_SHARE) * (self.pace * self.share).sigmoid()


def _residuals(factors: Tensor, torque: Tensor, numbers: Tensor) -> Tensor:
    """The residual torque [batch, sample, joint] with these numbers, in double precision."""
    return torque.double() - _times(factors[..., :-1].double(), numbers.double()[:, None]) - factors[..., -1].double()


def _stretch(residuals: Tensor, normals: Tensor, like: Tensor) -> Tensor:
    """A stretch of the torques `residuals` [batch, sample, joint] with the length of `like`, with a sign. The last
    of STRETCH normal numbers [batch, STRETCH], divided by their norm, is uniform from -1 to 1 (Archimedes). It
    gives the sign and the start of the stretch. Torques of a context that is too short are repeated."""
    samples, count = residuals.shape[1], like.shape[1]
    if samples == 0:
        return torch.zeros_like(like)
    starts = samples - count + 1 if samples >= count else samples
    side = normals[:, -1] / normals.square().sum(-1).sqrt()
    first = (side.abs() * starts).long().clamp(max=starts - 1)
    index = (first[:, None] + torch.arange(count, device=like.device)) % samples
    stretch = residuals.gather(1, index[..., None].expand(-1, -1, residuals.shape[2]))
    return torch.where(side[:, None, None] < 0, -stretch, stretch)


def _at_least_0(numbers: Tensor, bounded: Tensor) -> Tensor:
    return torch.where(bounded, numbers.clamp(min=0), numbers)


def _factored(matrix: Tensor, least: Tensor) -> tuple[Tensor, Tensor]:
    """L and D of L D Lᵀ [.., joint, joint]. Entries of D below `least` are raised to it for the later ones, and D
    has the values before that. The sum of the diagonal matrix `least` and a positive semidefinite matrix has no
    such entry."""
    columns, pivots = [], []
    for column in range(len(least)):
        pivot = matrix[..., column, column]
        raised = torch.maximum(pivot, least[column])[..., None]
        entries = torch.nn.functional.pad(matrix[..., column + 1 :, column] / raised, (column + 1, 0))
        matrix = matrix - raised[..., None] * entries[..., :, None] * entries[..., None, :]
        columns.append(entries)
        pivots.append(pivot)
    return torch.stack(columns, -1) + torch.eye(len(least)).to(matrix), torch.stack(pivots, -1)


def _is_solid(inertia: Tensor, armature: Tensor) -> Tensor:
    """Whether mass matrices [.., joint, joint] have enough inertia [..]."""
    _, pivots = _factored(inertia, armature)
    return (pivots / armature).min(-1).values >= LEAST_PIVOT


def _solved(matrix: Tensor, right: Tensor, least: Tensor) -> Tensor:
    """The solution x of matrix x = right, with the entries of D raised to `least`."""
    lower, pivots = _factored(matrix, least)
    x = torch.linalg.solve_triangular(lower, right[..., None], upper=False, unitriangular=True)
    x = x / torch.maximum(pivots, least)[..., None]
    return torch.linalg.solve_triangular(lower.mT, x, upper=True, unitriangular=True)[..., 0]


def _times(matrix: Tensor, vector: Tensor) -> Tensor:
    return (matrix @ vector[..., None])[..., 0]


TWINS = {"lagrangian": Lagrangian}

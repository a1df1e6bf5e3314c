"""The PyTorch twin of `crates/models/src/diffusion/`: noise schedules and samplers.

A sampler is a table: at each of its levels the series becomes
`noisy * x + clean * x0 + previous_clean * x0 of the step before + noise * epsilon`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass
class Step:
    level: int
    noisy: float = 0.0
    clean: float = 1.0
    previous_clean: float = 0.0
    noise: float = 0.0


def signal_shares(steps: int, schedule: str) -> list[float]:
    """alpha-bar of every level."""

    def cosine(level: int) -> float:
        return math.cos((level / steps + 0.008) / 1.008 * math.pi / 2) ** 2

    def beta(level: int) -> float:
        if schedule == "cosine":
            return min(1 - cosine(level + 1) / cosine(level), 0.999)
        progress = level / max(steps - 1, 1)
        return min(1000 / steps * (1e-4 + progress * (0.02 - 1e-4)), 0.999)

    shares, product = [], 1.0
    for level in range(steps):
        product *= 1 - beta(level)
        shares.append(product)
    return shares


def visited_levels(levels: int, steps: int | None, spacing: str) -> list[int]:
    count = min(steps or levels, levels)

    def rounded(numerator: int, denominator: int) -> int:
        return (2 * numerator + denominator) // (2 * denominator)

    left = range(count - 1, -1, -1)
    if spacing == "trailing":
        return [rounded(levels * (i + 1), count) - 1 for i in left]
    if spacing == "leading":
        return [levels // count * i for i in left]
    if count == 1:
        return [levels - 1]
    return [rounded((levels - 1) * i, count - 1) for i in left]


def sampler_steps(shares: list[float], sampler: dict, warm: int | None = None) -> list[Step]:
    """The steps of a sampler. With `warm` they are that many last levels of the training, one by one."""
    if warm is None:
        levels = visited_levels(len(shares), sampler.get("steps"), sampler.get("spacing", "trailing"))
    else:
        levels = list(range(min(warm, len(shares)) - 1, -1, -1))
    kind, eta = sampler.get("kind", "ddpm"), sampler.get("eta", 0.0)

    def half_log_ratio(share: float) -> float:
        return 0.5 * math.log(share / (1 - share))

    steps = []
    for index, level in enumerate(levels[:-1]):
        share, following = shares[level], shares[levels[index + 1]]
        kept = share / following
        variance = (1 - following) / (1 - share) * (1 - kept)
        if kind == "ddpm":
            noisy = math.sqrt(kept) * (1 - following) / (1 - share)
            clean = math.sqrt(following) * (1 - kept) / (1 - share)
            steps.append(Step(level, noisy, clean, noise=math.sqrt(max(variance, 1e-20))))
        elif kind == "ddim":
            noise = eta * math.sqrt(variance)
            noisy = math.sqrt(max(1 - following - noise**2, 0.0) / (1 - share))
            steps.append(Step(level, noisy, math.sqrt(following) - noisy * math.sqrt(share), noise=noise))
        else:
            length = half_log_ratio(following) - half_log_ratio(share)
            clean = -math.sqrt(following) * math.expm1(-length)
            ratio = 0.0
            if index > 0:
                ratio = 0.5 * length / (half_log_ratio(share) - half_log_ratio(shares[levels[index - 1]]))
            noisy = math.sqrt((1 - following) / (1 - share))
            steps.append(Step(level, noisy, clean * (1 + ratio), -clean * ratio))
    return [*steps, Step(levels[-1])]


class NoiseLevels:
    """Level n is the series sqrt(share) x0 + sqrt(1 - share) epsilon."""

    def __init__(self, diffusion: dict):
        self.shares = signal_shares(diffusion["steps"], diffusion["schedule"])
        self.prediction, self.clip = diffusion["prediction"], diffusion["clip"]

    def noisy(self, level: int) -> tuple[float, float]:
        return math.sqrt(self.shares[level]), math.sqrt(1 - self.shares[level])

    def clean_series(self, level: int, noisy: Tensor, answer: Tensor) -> Tensor:
        """x0 from the noisy series and the network's answer."""
        share = self.shares[level]
        match self.prediction:
            case "noise":
                return noisy / math.sqrt(share) - math.sqrt((1 - share) / share) * answer
            case "x0":
                return answer
            case "v":
                return math.sqrt(share) * noisy - math.sqrt(1 - share) * answer
        raise ValueError(f"prediction {self.prediction!r} is none of noise, x0, v")

    def steps(self, sampler: dict, warm: int | None) -> list[Step]:
        return sampler_steps(self.shares, sampler, warm)


@dataclass
class Painted:
    """The known part of a series. It has `values` where `clean` is 1, and `values` with the noise of the level
    where `noised` is 1. Masks are [1, sample, channel]."""

    values: Tensor
    clean: Tensor
    noised: Tensor

    def over(self, series: Tensor, noisy: tuple[float, float], noise: Tensor) -> Tensor:
        series = series * (1 - self.clean) + self.values * self.clean
        known = noisy[0] * self.values + noisy[1] * noise
        return series * (1 - self.noised) + known * self.noised


def sample(
    network: Callable[[Tensor, Tensor], Tensor],
    painted: Painted,
    mixing,
    sampler: dict,
    draw: Callable[[], Tensor],
    warm: tuple[Tensor, int] | None = None,
) -> Tensor:
    """The clean series that `network` makes. It begins with noise from `draw`, or with a warm start: a guess of the
    whole series and the number of steps from there. `mixing` is `NoiseLevels` or a flow's `StraightLines`."""
    steps = mixing.steps(sampler, warm and warm[1])
    first = draw()
    x = first
    if warm is not None:
        of_guess, of_noise = mixing.noisy(steps[0].level)
        x = of_guess * warm[0] + of_noise * first
    before = None
    for step in steps:
        x = painted.over(x, mixing.noisy(step.level), first)
        levels = torch.full((len(x),), step.level, device=x.device)
        clean = mixing.clean_series(step.level, x, network(x, levels))
        if mixing.clip is not None:
            clean = clean.clamp(-mixing.clip, mixing.clip)
        x = step.noisy * x + step.clean * clean
        if before is not None:
            x = x + step.previous_clean * before
        if step.noise:
            x = x + step.noise * draw()
        before = clean
    return painted.over(x, (1.0, 0.0), first)

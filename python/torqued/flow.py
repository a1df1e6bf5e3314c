"""The PyTorch twin of `crates/models/src/diffusion/flow.rs`, and the network of a flow."""

import math

from torch import Tensor

from .cdcnn import Cdcnn
from .diffusion import Step, visited_levels

LEVELS = 1000
STEPS = 2
"""The number of steps of a sampler that names none."""


class StraightLines:
    """Level n is the time t = (n + 1) / 1000, at which the series is (1 - t) x0 + t epsilon."""

    clip = None

    def __init__(self, model: dict):
        self.prediction = model["prediction"]
        self.warm_levels = math.floor(model["warm_start_time"] * LEVELS + 0.5)

    def noisy(self, level: int) -> tuple[float, float]:
        return 1 - _time(level), _time(level)

    def clean_series(self, level: int, noisy: Tensor, answer: Tensor) -> Tensor:
        return answer if self.prediction == "x0" else noisy - _time(level) * answer

    def steps(self, sampler: dict, warm: int | None) -> list[Step]:
        if warm is None:
            levels = visited_levels(LEVELS, sampler.get("steps") or STEPS, "trailing")
        else:
            levels = visited_levels(self.warm_levels, warm, "trailing")
        steps = []
        for level, following in zip(levels, levels[1:]):
            ratio = _time(following) / _time(level)
            steps.append(Step(level, ratio, 1 - ratio))
            if sampler["kind"] == "heun":
                half = (1 - ratio) / (2 * ratio)
                steps.append(Step(following, 1.0, half, -half))
        return [*steps, Step(levels[-1])]


def _time(level: int) -> float:
    return (level + 1) / LEVELS


class Flow(Cdcnn):
    """A flow with CDCNN's network."""

    mixing = StraightLines


TWINS = {"flow": Flow}

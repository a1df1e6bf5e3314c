"""A checkpoint's `config.json` and `model.safetensors` as a model that predicts."""

import json
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import load_file

from .robomorph import RoboMorph

FORMAT_VERSION = 1
SMALLEST_STANDARD_DEVIATION = 1e-3
"""As in `models/src/normalization.rs`; N·m and rad."""


class TrainedModel:
    """A network with the normalization it was trained with."""

    def __init__(self, network: torch.nn.Module, config: dict):
        self.network = network.eval()
        self.config = config

    def predict(self, u: np.ndarray, y_context: np.ndarray) -> np.ndarray:
        """Joint positions of the horizon in rad, [batch, horizon, 7].

        `u` [batch, samples, 7] in N·m, `y_context` [batch, context, 7] in rad.
        """
        context = self.config["context"]
        expected = (len(u), self.config["samples"], 7), (len(u), context, 7)
        if (u.shape, y_context.shape) != expected:
            raise ValueError(f"u and y_context have shapes {u.shape} and {y_context.shape}, expected {expected}")
        u = torch.as_tensor(u, dtype=torch.float32)
        y = torch.as_tensor(y_context, dtype=torch.float32)
        u_mean, u_std, y_mean, y_std = self._statistics(u[:, :context], y)
        u = (u - u_mean) / u_std
        y = (y - y_mean) / y_std
        with torch.inference_mode():
            predicted = self.network(torch.cat([u[:, :context], y], -1), u[:, context:])
        return (predicted * y_std + y_mean).numpy()

    def _statistics(self, u: torch.Tensor, y: torch.Tensor) -> list[torch.Tensor]:
        match self.config["normalizer"]:
            case "context":
                return [*_mean_and_deviation(u), *_mean_and_deviation(y)]
            case {"dataset": fixed}:
                return [torch.tensor(fixed[name]) for name in ("u_mean", "u_std", "y_mean", "y_std")]
            case other:
                raise ValueError(f"normalizer {other!r} needs the horizon it predicts")


def load(directory: str | Path) -> TrainedModel:
    """The checkpoint in `directory`."""
    directory = Path(directory)
    config = json.loads((directory / "config.json").read_text())
    if config["format_version"] > FORMAT_VERSION:
        raise ValueError(
            f"config.json has format version {config['format_version']}, "
            f"this package reads {FORMAT_VERSION} and older"
        )
    sizes = dict(config["model"])
    architecture = sizes.pop("architecture")
    if architecture != "robomorph":
        raise ValueError(f"architecture {architecture!r} has no twin here")
    network = RoboMorph(**sizes, context=config["context"], horizon=config["horizon"])
    network.load_state_dict(load_file(directory / "model.safetensors"))
    return TrainedModel(network, config)


def _mean_and_deviation(series: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Of each trajectory and channel, [batch, 1, 7]; population deviation, not below the smallest."""
    series = series.double()
    deviation = series.std(dim=1, keepdim=True, correction=0).clamp(min=SMALLEST_STANDARD_DEVIATION)
    return series.mean(dim=1, keepdim=True).float(), deviation.float()

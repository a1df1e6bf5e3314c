"""Loads a checkpoint, `config.json` and `model.safetensors`, as a model that predicts."""

import hashlib
import inspect
import json
import pkgutil
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import load_file, save_file
from torch import Tensor

from .diffusion import NoiseLevels, Painted, sample
from .frame import frames, known_series, known_series_per_joint

FORMAT_VERSION = 2
SMALLEST_STANDARD_DEVIATION = 1e-3
"""The smallest standard deviation, as in `crates/models/src/normalization.rs`; N·m and rad."""


def twins() -> dict[str, type[torch.nn.Module]]:
    """The networks of this package by architecture. Each module with a network lists it in `TWINS`."""
    found = {}
    for module in pkgutil.iter_modules([str(Path(__file__).parent)]):
        if module.name != "checkpoint":
            found |= getattr(import_module(f".{module.name}", __package__), "TWINS", {})
    return found


class TrainedModel:
    """A network with the normalization of its training."""

    def __init__(self, network: torch.nn.Module, config: dict):
        self.network = network.eval()
        self.config = config
        self._digest = _digest(network)
        """The digest of the weights that `config` describes."""

    def predict(
        self,
        u: np.ndarray,
        y_context: np.ndarray,
        *,
        sampler: dict | None = None,
        seed: int = 0,
        draw: Callable[[], Tensor] | None = None,
    ) -> np.ndarray:
        """Joint positions of the horizon in rad, [batch, horizon, joint].

        `u` is [batch, samples, joint] in N·m, and `y_context` is [batch, context, joint] in rad. Their lengths must be
        those of the training, or lengths for which the network's `answers` is true. A denoiser uses `sampler`, by
        default the checkpoint's, and noise [batch, samples, channels] from `draw`, or by default from PyTorch with
        `seed`. torqued draws other numbers.
        """
        config = self.config
        joints = joints_of(config)
        context, samples = y_context.shape[1], u.shape[1]
        if not (hasattr(self.network, "answers") and self.network.answers(context, samples)):
            context, samples = config["context"], config["samples"]
        expected = (len(u), samples, joints), (len(u), context, joints)
        if (u.shape, y_context.shape) != expected:
            raise ValueError(
                f"u and y_context have the shapes {u.shape} and {y_context.shape}, allowed: [batch, {samples}, {joints}] "
                f"and [batch, {context}, {joints}] of one batch; one robot is a batch of 1: u[None], y_context[None]"
            )
        u = torch.as_tensor(u, dtype=torch.float32)
        y = torch.as_tensor(y_context, dtype=torch.float32)
        u_mean, u_std, y_mean, y_std = self._statistics(u[:, :context], y)
        center, scale = frames(config, u, y, y_mean, y_std)
        seen = (y - center[:, :context]) / scale[:, :context]
        path = (center - y_mean) / y_std
        u = (u - u_mean) / u_std
        y = (y - y_mean) / y_std
        unit = scale / y_std
        known = known_series(self.network, u, path, unit)
        with torch.inference_mode():
            if hasattr(self.network, "answer"):
                beside = {"y_context": y, "seen": seen, "path": path, "unit": unit}
                predicted = self.network.answer(known, **wanted(self.network.answer, beside))
            else:
                if draw is None:
                    generator = torch.Generator().manual_seed(seed)
                    shape = (*u.shape[:2], self.network.channels)
                    draw = lambda: torch.randn(shape, generator=generator)  # noqa: E731
                predicted = self._sample(known, seen, sampler or config["model"]["sampler"], draw)
        return (predicted * scale[:, context:] + center[:, context:]).numpy()

    def _sample(self, known: Tensor, seen: Tensor, sampler: dict, draw: Callable[[], Tensor]) -> Tensor:
        model, context = self.config["model"], self.config["context"]
        samples, joints = known.shape[1], joints_of(self.config)
        y_known = (torch.arange(samples) < context).float()[None, :, None].expand(1, samples, joints)
        values = torch.cat([seen, torch.zeros(len(known), samples - context, joints)], 1)
        clean, noised = y_known, torch.zeros_like(y_known)
        if self.network.channels > joints:
            joint = model["known"] == "joint-noise"
            values = torch.cat([known[..., :joints], values], -1)
            ones, zeros = torch.ones_like(y_known), torch.zeros_like(y_known)
            clean = torch.cat([zeros if joint else ones, y_known], -1)
            noised = torch.cat([ones if joint else zeros, zeros], -1)
        painted = Painted(values, clean, noised)
        mixing = self.network.mixing(model) if hasattr(self.network, "mixing") else NoiseLevels(model["diffusion"])
        series = sample(lambda noisy, levels: self.network(noisy, levels, known), painted, mixing, sampler, draw)
        return series[:, context:, -joints:]

    def _statistics(self, u: Tensor, y: Tensor) -> list[Tensor]:
        match self.config["normalizer"]:
            case "context":
                return [*_mean_and_deviation(u), *_mean_and_deviation(y)]
            case {"dataset": fixed}:
                return [torch.tensor(fixed[name]) for name in ("u_mean", "u_std", "y_mean", "y_std")]
            case "none":
                joints = joints_of(self.config)
                return [torch.zeros(joints), torch.ones(joints)] * 2
            case other:
                raise ValueError(f"normalizer {other!r} needs the horizon it predicts")


def load(directory: str | Path) -> TrainedModel:
    """Loads the checkpoint in `directory`, of any architecture.

    Raises NotImplementedError for a `lagrangian` with a field of `Lagrangian.LACKS`, such as one that is told its arm.
    """
    directory = Path(directory)
    config = json.loads((directory / "config.json").read_text())
    if config["format_version"] != FORMAT_VERSION:
        raise ValueError(
            f"config.json has format version {config['format_version']}, "
            f"this package reads {FORMAT_VERSION}"
        )
    network = network_of(config)
    network.load_state_dict(load_file(directory / "model.safetensors"))
    return TrainedModel(network, config)


def save(model: TrainedModel, directory: str | Path) -> None:
    """Writes the files that `load` reads. Weights are written in single precision.

    If the weights have changed since `load`, config.json describes a fine-tuning: `init` names the training of the
    loaded weights, and the metrics and the device of that training are left out.
    """
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    weights = {
        name: tensor.detach().to("cpu", torch.float32).contiguous()
        for name, tensor in model.network.state_dict().items()
    }
    save_file(weights, directory / "model.safetensors", {"format": "pt"})
    is_changed = _digest(model.network) != model._digest
    config = fine_tuned(model.config) if is_changed else model.config
    (directory / "config.json").write_text(json.dumps(config, indent=2) + "\n")


def fine_tuned(config: dict) -> dict:
    """The config of weights that were changed in PyTorch after the training that `config` describes."""
    kept = {name: value for name, value in config.items() if name not in ("metrics", "device", "ema")}
    origin = {name: config[name] for name in ("spec_digest", "step")}
    return kept | {"spec_digest": "pytorch", "step": 0, "init": origin}


def wanted(function: Callable, known: dict) -> dict:
    """The entries of `known` that are parameters of `function`."""
    return {name: known[name] for name in inspect.signature(function).parameters if name in known}


def joints_of(config: dict) -> int:
    """Joints of the arm. A config without the field has seven."""
    return config.get("joints", 7)


def network_of(config: dict) -> torch.nn.Module:
    """The network that a checkpoint's config describes, with PyTorch's initial weights."""
    architecture, networks = config["model"]["architecture"], twins()
    if architecture not in networks:
        raise ValueError(f"architecture {architecture!r} has no twin here, only {', '.join(networks)}")
    network = networks[architecture]
    lacking = [name for name in getattr(network, "LACKS", ()) if config["model"].get(name) not in (None, False)]
    if lacking:
        raise NotImplementedError(
            f"the PyTorch twin has no {architecture} with {' and '.join(lacking)}; ask torqued for its predictions: "
            "Client.predict, `torqued predict` or POST /v1/checkpoints/ID/predict"
        )
    sizes = {name: config[name] for name in ("context", "horizon", "samples", "rate_hz")}
    sizes |= {"joints": joints_of(config), "series_per_joint": known_series_per_joint(config)} | config["model"]
    return network(**wanted(network, sizes))


def _mean_and_deviation(series: Tensor) -> tuple[Tensor, Tensor]:
    """Mean and population standard deviation of each trajectory and channel, [batch, 1, joint]. The deviation is at
    least the smallest one."""
    series = series.double()
    deviation = series.std(dim=1, keepdim=True, correction=0).clamp(min=SMALLEST_STANDARD_DEVIATION)
    return series.mean(dim=1, keepdim=True).float(), deviation.float()


def _digest(network: torch.nn.Module) -> bytes:
    """A digest of the network's weights in single precision."""
    digest = hashlib.sha256()
    for name, tensor in sorted(network.state_dict().items()):
        digest.update(name.encode())
        digest.update(tensor.detach().to("cpu", torch.float32).contiguous().numpy().tobytes())
    return digest.digest()

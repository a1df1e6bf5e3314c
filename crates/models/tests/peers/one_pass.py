"""Makes the files of ../data/NAME/ for models that answer in one pass: PyTorch's weights, their predictions,
gradients, and the weights after four optimizer steps. `src/agreement_with_pytorch.rs` must compute the same numbers.

    PYTHONPATH=../../../../python python one_pass.py [NAME ...]

For a new one, write ../data/NAME/config.json first. Only its field `model` is read. Without names, all files are made.
"""

import json
import math
import sys
from pathlib import Path

import torch
from safetensors.torch import save_file
from torqued import FORMAT_VERSION, TrainedModel
from torqued.checkpoint import network_of, wanted
from torqued.frame import frames, known_series
from torqued.lagrangian import DRAWS, SCORED, STRETCH

from randomness import CUT, TRAINING, below, normals, words

DATA = Path(__file__).parent.parent / "data"
CONTEXT, HORIZON, BATCH = 8, 6, 3
RATE_HZ = 60.0
LEARNING_RATES = [5e-3, 1e-2, 1e-2, 1e-2 * (0.1 + 0.9 * 0.5)]
"""Two steps of warmup to 1e-2, then a cosine that would reach a tenth of it after four."""
STEP_OF_GRADIENTS = 2
"""The step whose random numbers are used for the gradients. It scores draws of one robot."""


def main(folder: Path, model: dict) -> None:
    torch.manual_seed(1)
    samples = CONTEXT + HORIZON
    sizes = {"context": CONTEXT, "horizon": HORIZON, "samples": samples, "rate_hz": RATE_HZ}
    network = network_of({"model": model, **sizes})
    is_physical = getattr(network, "is_physical", False)
    for parameter in network.parameters():
        # Norm weights of 1, biases of 0 and near-uniform attention would hide mistakes.
        parameter.data += 0.3 / getattr(network, "pace", 1.0) * torch.randn_like(parameter)
    if model.get("head") == "gaussian":
        # Otherwise a few entries of small variance would dominate the loss. Their sums would
        # cancel, in PyTorch's single precision and in any other.
        network.head.weight.data *= 0.3

    time = torch.arange(samples) / RATE_HZ
    amplitude = torch.randn(BATCH, 1, 7)
    u = 3.0 * amplitude * torch.sin(9.0 * torch.rand(BATCH, 1, 7) * time[None, :, None]) + 0.3 * torch.randn(BATCH, 1, 7)
    y = torch.randn(BATCH, 1, 7) + torch.cumsum(u, 1) / 10.0
    if is_physical:
        u, y = damped_swings(samples)

    u_mean, u_std = torch.full((7,), 0.1), torch.linspace(0.5, 2.0, 7)
    y_mean, y_std = torch.linspace(-0.3, 0.4, 7), torch.linspace(0.2, 0.9, 7)
    statistics = {"u_mean": u_mean, "u_std": u_std, "y_mean": y_mean, "y_std": y_std}
    dataset = {"dataset": {name: value.tolist() for name, value in statistics.items()}}
    config = {
        "format_version": FORMAT_VERSION,
        "model": model,
        **sizes,
        "normalizer": "none" if is_physical else dataset,
        "parameters": sum(parameter.numel() for parameter in network.parameters()),
        "step": 0,
        "seed": 0,
        "spec_digest": "pytorch",
        "versions": {"torqued": "0.1.0", "burn": f"none, torch {torch.__version__}"},
    }

    (folder / "config.json").write_text(json.dumps(config, indent=1) + "\n")
    weights = {name: tensor.clone() for name, tensor in network.state_dict().items()}
    save_file(weights, folder / "model.safetensors", {"format": "pt"})
    expected = {"u": u, "y": y}

    for normalizer in ["none"] if is_physical else ["context", dataset]:
        trained = TrainedModel(network, {**config, "normalizer": normalizer})
        kind = normalizer if isinstance(normalizer, str) else "dataset"
        expected[f"prediction.{kind}"] = torch.tensor(trained.predict(u.numpy(), y[:, :CONTEXT].numpy()))
        if "least_context" in model:
            context, end = model["least_context"], samples - model["patch"]
            shorter = trained.predict(u[:, :end].numpy(), y[:, :context].numpy())
            expected["prediction.shorter"] = torch.tensor(shorter)

    # The rest runs in double precision, so that any difference is torqued's.
    network.double()
    u_normal, y_normal = ((u - u_mean) / u_std).double(), ((y - y_mean) / y_std).double()
    if is_physical:
        u_normal, y_normal = u.double(), y.double()
        y_mean, y_std = torch.zeros(7), torch.ones(7)
    optimizer = torch.optim.AdamW(network.parameters(), betas=(0.9, 0.95), eps=1e-3, weight_decay=0.05)

    def loss_of_step(step: int, context: int) -> torch.Tensor:
        optimizer.zero_grad()
        center, scale = frames(config, u, y[:, :context], y_mean, y_std)
        y_seen = ((y - center) / scale).double()
        known = {
            "y_context": y_normal[:, :context],
            "seen": y_seen[:, :context],
            "y_horizon": y_seen[:, context:],
            "path": ((center - y_mean) / y_std).double(),
            "unit": (scale / y_std).double(),
        }
        known_inputs = known_series(network, u_normal, known["path"], known["unit"])
        drawn = draws_of_step(network, step) if hasattr(network, "draws") else {}
        loss = network.loss(known_inputs, **wanted(network.loss, known), **drawn)
        loss.backward()
        return loss

    loss_of_step(STEP_OF_GRADIENTS, CONTEXT)
    expected |= {f"gradient.{name}": p.grad.clone() for name, p in network.named_parameters()}
    for step, learning_rate in enumerate(LEARNING_RATES):
        loss = loss_of_step(step + 1, context_of_step(model, step + 1))
        expected[f"loss.{step}"] = loss.detach().reshape(1)
        norm = torch.nn.utils.clip_grad_norm_(network.parameters(), max_norm=0.5)
        expected[f"gradient_norm.{step}"] = norm.reshape(1)
        for group in optimizer.param_groups:
            group["lr"] = learning_rate
        optimizer.step()
    expected |= {f"after.{name}": tensor.clone() for name, tensor in network.state_dict().items()}
    save_file({name: tensor.float().contiguous() for name, tensor in expected.items()}, folder / "expected.safetensors")


def context_of_step(model: dict, step: int) -> int:
    """Samples of the context in a step of training with seed 0."""
    least = model.get("least_context", CONTEXT)
    if least == CONTEXT:
        return CONTEXT
    choices = (CONTEXT - least) // model["patch"] + 1
    return least + model["patch"] * below(words((0, CUT, step, 0)), choices)


def draws_of_step(network: torch.nn.Module, step: int) -> dict:
    """The robots whose draws a step of training with seed 0 scores, and the normal numbers of these draws."""
    chosen, drawn = [], []
    count = DRAWS * (sum(network.counts) + 1 + STRETCH)
    for row in range(BATCH):
        source = words((0, TRAINING, step, row))
        # The points of the context have only one possible start.
        below(source, 1)
        chosen.append(below(source, min(network.points, SCORED)) == 0)
        drawn.append(torch.tensor(normals(source, count), dtype=torch.float64).unflatten(0, (DRAWS, -1)))
    return {"chosen": torch.tensor(chosen), "normals": torch.stack(drawn)}


def damped_swings(samples: int) -> tuple[torch.Tensor, torch.Tensor]:
    """u and y of joints that swing at about 1 rad/s and 20 rad/s², so that inertia and damping show."""
    time = torch.arange(samples + 1)[None, :, None] / RATE_HZ

    def wave() -> torch.Tensor:
        frequency_hz, turns = 2.0 + 3.0 * torch.rand(BATCH, 1, 7), torch.rand(BATCH, 1, 7)
        return torch.randn(BATCH, 1, 7) * torch.sin(2.0 * math.pi * (frequency_hz * time + turns))

    y = torch.randn(BATCH, 1, 7) + 0.05 * wave()
    damping = 0.5 + 3.0 * torch.rand(BATCH, 1, 7)
    u = damping * RATE_HZ * y.diff(dim=1) + 0.3 * wave()[:, :samples]
    return u, y[:, :samples]


for folder in [DATA / name for name in sys.argv[1:]] or sorted(DATA.iterdir()):
    model = json.loads((folder / "config.json").read_text())["model"]
    if "sampler" not in model:
        main(folder, model)

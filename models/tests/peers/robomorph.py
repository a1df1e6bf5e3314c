"""Makes ../data/robomorph/ and ../data/robomorph_gaussian/: a small RoboMorph of PyTorch's, what it
predicts, its gradients, and its weights after four optimizer steps, with either head.
`src/agreement_with_pytorch.rs` must get the same.

    pip install ../../../python && python robomorph.py
"""

import json
from pathlib import Path

import torch
from safetensors.torch import save_file
from torqued import FORMAT_VERSION, RoboMorph, TrainedModel

DATA = Path(__file__).parent.parent / "data"
SIZES = dict(d_model=8, heads=2, encoder_layers=2, decoder_layers=2, patch=2, mlp_ratio=2)
CONTEXT, HORIZON, BATCH = 8, 6, 3
LEARNING_RATES = [5e-3, 1e-2, 1e-2, 1e-2 * (0.1 + 0.9 * 0.5)]
"""Two steps of warmup to 1e-2, then a cosine that would reach a tenth of it after four."""


def make(folder: Path, head: str) -> None:
    torch.manual_seed(1)
    sizes = {**SIZES, **({"head": head} if head != "point" else {})}
    network = RoboMorph(**sizes, context=CONTEXT, horizon=HORIZON)
    for parameter in network.parameters():
        # Norm weights of 1, biases of 0 and near-uniform attention would hide mistakes.
        parameter.data += 0.3 * torch.randn_like(parameter)
    if network.gaussian:
        # Else few entries, of small variance, make the loss: sums that cancel, in PyTorch's single
        # precision as in any.
        network.head.weight.data *= 0.3

    samples = CONTEXT + HORIZON
    time = torch.arange(samples) / 60.0
    amplitude = torch.randn(BATCH, 1, 7)
    u = 3.0 * amplitude * torch.sin(9.0 * torch.rand(BATCH, 1, 7) * time[None, :, None]) + 0.3 * torch.randn(BATCH, 1, 7)
    y = torch.randn(BATCH, 1, 7) + torch.cumsum(u, 1) / 10.0

    u_mean, u_std = torch.full((7,), 0.1), torch.linspace(0.5, 2.0, 7)
    y_mean, y_std = torch.linspace(-0.3, 0.4, 7), torch.linspace(0.2, 0.9, 7)
    statistics = {"u_mean": u_mean, "u_std": u_std, "y_mean": y_mean, "y_std": y_std}
    config = {
        "format_version": FORMAT_VERSION,
        "model": {"architecture": "robomorph", **sizes},
        "context": CONTEXT,
        "horizon": HORIZON,
        "samples": samples,
        "rate_hz": 60.0,
        "normalizer": {"dataset": {name: value.tolist() for name, value in statistics.items()}},
        "parameters": sum(parameter.numel() for parameter in network.parameters()),
        "step": 0,
        "seed": 0,
        "spec_digest": "pytorch",
        "versions": {"torqued": "0.1.0", "burn": f"none, torch {torch.__version__}"},
    }

    folder.mkdir(parents=True, exist_ok=True)
    (folder / "config.json").write_text(json.dumps(config, indent=1) + "\n")
    weights = {name: tensor.clone() for name, tensor in network.state_dict().items()}
    save_file(weights, folder / "model.safetensors", {"format": "pt"})
    expected = {"u": u, "y": y}

    for normalizer in ["context", config["normalizer"]]:
        model = TrainedModel(network, {**config, "normalizer": normalizer})
        name = normalizer if isinstance(normalizer, str) else "dataset"
        expected[f"prediction.{name}"] = torch.tensor(model.predict(u.numpy(), y[:, :CONTEXT].numpy()))

    # From here on in double precision, so that the differences found are torqued's alone.
    network.double()
    u_normal, y_normal = ((u - u_mean) / u_std).double(), ((y - y_mean) / y_std).double()
    known = torch.cat([u_normal[:, :CONTEXT], y_normal[:, :CONTEXT]], -1)
    optimizer = torch.optim.AdamW(network.parameters(), betas=(0.9, 0.95), eps=1e-3, weight_decay=0.05)
    for step, learning_rate in enumerate(LEARNING_RATES):
        optimizer.zero_grad()
        answer, truth = network(known, u_normal[:, CONTEXT:]), y_normal[:, CONTEXT:]
        if network.gaussian:
            mean, log_variance = network.mean_and_log_variance(answer)
            loss = 0.5 * ((truth - mean) ** 2 * torch.exp(-log_variance) + log_variance).mean()
        else:
            loss = torch.nn.functional.mse_loss(answer, truth)
        loss.backward()
        expected[f"loss.{step}"] = loss.detach().reshape(1)
        if step == 0:
            expected |= {f"gradient.{name}": p.grad.clone() for name, p in network.named_parameters()}
        norm = torch.nn.utils.clip_grad_norm_(network.parameters(), max_norm=0.5)
        expected[f"gradient_norm.{step}"] = norm.reshape(1)
        for group in optimizer.param_groups:
            group["lr"] = learning_rate
        optimizer.step()
    expected |= {f"after.{name}": tensor.clone() for name, tensor in network.state_dict().items()}
    save_file({name: tensor.float() for name, tensor in expected.items()}, folder / "expected.safetensors")


make(DATA / "robomorph", "point")
make(DATA / "robomorph_gaussian", "gaussian")

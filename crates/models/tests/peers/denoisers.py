"""Makes the files of ../data/NAME/ for denoisers: PyTorch's weights, their answers, gradients, the weights after a
step of Adam, and the results of all steps of a sampler for given noise. `src/agreement_with_pytorch.rs` must compute
the same numbers.

    PYTHONPATH=../../../../python python denoisers.py [NAME ...]

For a new one, write ../data/NAME/config.json first. Only its field `model` is read. Without names, all files are made.
"""

import json
import sys
from pathlib import Path

import torch
from safetensors.torch import save_file
from torqued import FORMAT_VERSION, TrainedModel
from torqued.checkpoint import network_of

DATA = Path(__file__).parent.parent / "data"
CONTEXT, HORIZON, BATCH = 16, 8, 3
SAMPLES = CONTEXT + HORIZON
NOISE_LEVELS = 20
"""The number of noise levels of every diffusion here."""
SAMPLER = {"kind": "ddpm", "steps": None, "eta": 0.0, "spacing": "trailing"}
LEVELS = torch.tensor([3, 17, 0])
CHAINS = {
    "ddpm": {},
    "ddim": {"kind": "ddim"},
    "ddim_7": {"kind": "ddim", "steps": 7},
    "dpm_solver_7": {"kind": "dpm-solver++", "steps": 7},
}
FLOW_CHAINS = {
    "euler_1": {"kind": "euler", "steps": 1},
    "euler_4": {"kind": "euler", "steps": 4},
    "heun_3": {"kind": "heun", "steps": 3},
}


def main(folder: Path, model: dict) -> None:
    torch.manual_seed(2)
    y_mean, y_std = torch.linspace(-0.3, 0.4, 7), torch.linspace(0.2, 0.9, 7)
    u_mean, u_std = torch.full((7,), 0.1), torch.linspace(0.5, 2.0, 7)
    statistics = {"u_mean": u_mean, "u_std": u_std, "y_mean": y_mean, "y_std": y_std}
    config = {
        "format_version": FORMAT_VERSION,
        "model": model,
        "context": CONTEXT,
        "horizon": HORIZON,
        "samples": SAMPLES,
        "rate_hz": 60.0,
        "normalizer": {"dataset": {key: value.tolist() for key, value in statistics.items()}},
        "parameters": 0,
        "step": 0,
        "seed": 0,
        "spec_digest": "pytorch",
        "versions": {"torqued": "0.1.0", "burn": f"none, torch {torch.__version__}"},
    }
    network = network_of(config)
    config["parameters"] = sum(parameter.numel() for parameter in network.parameters())
    for parameter in network.parameters():
        # Norm weights of 1, biases of 0 and near-uniform attention would hide mistakes.
        parameter.data += 0.1 * torch.randn_like(parameter)

    time = torch.arange(SAMPLES) / 60.0
    u = 3.0 * torch.randn(BATCH, 1, 7) * torch.sin(9.0 * torch.rand(BATCH, 1, 7) * time[None, :, None])
    u += 0.3 * torch.randn(BATCH, SAMPLES, 7)
    y = 0.3 * torch.randn(BATCH, 1, 7) + torch.cumsum(u, 1) / 100.0
    shape = (BATCH, SAMPLES, network.channels)
    noise = torch.randn(shape)
    ddpm_noise = torch.stack([noise, *(torch.randn(shape) for _ in range(NOISE_LEVELS - 1))])
    expected = {"u": u, "y": y, "noise": noise}
    is_flow = "diffusion" not in model
    if not is_flow:
        expected["ddpm_noise"] = ddpm_noise

    (folder / "config.json").write_text(json.dumps(config, indent=1) + "\n")
    weights = {key: tensor.clone() for key, tensor in network.state_dict().items()}
    save_file(weights, folder / "model.safetensors", {"format": "pt"})

    trained = TrainedModel(network, config)
    seen = {}

    def keep(known, seen_context, sampler, draw):
        seen["known"] = known
        seen["answer"] = TrainedModel._sample(trained, known, seen_context, sampler, draw)
        return seen["answer"]

    trained._sample = keep
    for chain, change in (FLOW_CHAINS if is_flow else CHAINS).items():
        given = iter(ddpm_noise)
        trained.predict(u.numpy(), y[:, :CONTEXT].numpy(), sampler=SAMPLER | change, draw=lambda: next(given))
        expected[f"chain.{chain}"] = seen["answer"].clone()

    # The rest runs in double precision, so that any difference is torqued's.
    network.double()
    noisy, wanted = torch.randn(shape), torch.randn(shape)
    answer = network(noisy.double(), LEVELS, seen["known"].double().clone())
    optimizer = torch.optim.Adam(network.parameters(), lr=1e-2, betas=(0.9, 0.95), eps=1e-3)
    torch.nn.functional.mse_loss(answer, wanted.double()).backward()
    expected |= {"noisy": noisy, "answer_wanted": wanted, "answer": answer.detach()}
    expected |= {f"gradient.{key}": p.grad.clone() for key, p in network.named_parameters()}
    optimizer.step()
    expected |= {f"after.{key}": tensor.clone() for key, tensor in network.state_dict().items()}
    save_file({key: t.float().contiguous() for key, t in expected.items()}, folder / "expected.safetensors")


for folder in [DATA / name for name in sys.argv[1:]] or sorted(DATA.iterdir()):
    model = json.loads((folder / "config.json").read_text())["model"]
    if "sampler" in model:
        main(folder, model)

"""Measures the PyTorch twin of a network like `crates/models/examples/model_rates.rs` measures ours.

Reads a question from standard input, `{"config": .., "what": "training" | "inference", "compiled": .., "autocast":
.., "batch": .., "threads": .., "steps": ..}`, with the `config.json` of a checkpoint. Prints `{"version": .., "times": ..}` with the
same times. All in single precision, or with `torch.autocast` to bf16. A training step is noise, forward pass, loss, backward pass and Adam. Its
multiply-adds are those of PyTorch's matrix products and convolutions. A prediction is that of
`torqued.checkpoint.TrainedModel`, but a pass is that of the network alone. PYTHONPATH must contain the repository's
`python`. The question may have a `"device"`, such as "cuda", for steps and passes on it. There, `"tf32": true` lets
matrix products round their factors to TF32, and a training's times have the card's peak memory as
`peak_device_memory_mib`.
"""

import json
import resource
import sys
import time
from collections.abc import Callable

import numpy as np
import torch
import torch.nn.functional as F
from torch.utils.flop_counter import FlopCounterMode
from torqued.checkpoint import TrainedModel, network_of

PASSES, CHAINS = 20, 4


def milliseconds(count: int, action: Callable[[], object]) -> list[float]:
    def finish() -> None:
        action()
        if torch.get_default_device().type == "cuda":
            torch.cuda.synchronize()

    finish()
    times = []
    for _ in range(max(count, 1)):
        start = time.perf_counter()
        finish()
        times.append(1e3 * (time.perf_counter() - start))
    return times


def quantiles(times: list[float]) -> dict:
    p50, p99 = np.quantile(times, [0.5, 0.99], method="inverted_cdf")
    return {"p50": p50, "p99": p99}


def inputs(network: torch.nn.Module, config: dict, batch: int) -> list[torch.Tensor]:
    samples, context = config["samples"], config["context"]
    known = 7 * network.series_per_joint
    if config["model"]["architecture"] == "robomorph":
        return [torch.randn(batch, context, known + 7), torch.randn(batch, samples - context, known)]
    levels = torch.randint(config["model"]["diffusion"]["steps"], (batch,))
    return [torch.randn(batch, samples, network.channels), levels, torch.randn(batch, samples, known)]


def training(network: torch.nn.Module, question: dict) -> dict:
    config, steps, autocast = question["config"], question["steps"], question["autocast"]
    optimizer = torch.optim.Adam(network.parameters(), lr=6e-4)
    given = inputs(network, config, question["batch"])
    with torch.no_grad():
        target = torch.randn_like(network(*given))
    noise = torch.empty_like(given[0])
    forward = torch.compile(network) if question["compiled"] else network

    def step() -> None:
        optimizer.zero_grad(set_to_none=True)
        with torch.autocast(torch.get_default_device().type, torch.bfloat16, enabled=autocast):
            predicted = forward(given[0] + noise.normal_(), *given[1:])
        F.mse_loss(predicted.float(), target).backward()
        optimizer.step()

    times = milliseconds(steps, step)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    result = {"step_ms": float(np.median(times)), "peak_memory_mib": peak}
    if torch.get_default_device().type == "cuda":
        result["peak_device_memory_mib"] = torch.cuda.max_memory_allocated() / 2**20
    if not question["compiled"]:
        with FlopCounterMode(display=False) as counter:
            step()
        result["multiply_adds"] = counter.get_total_flops() / 2
    return result


def inference(network: torch.nn.Module, question: dict) -> dict:
    config, steps, autocast = question["config"], question["steps"], question["autocast"]
    given = inputs(network, config, 1)
    network.eval()
    if question["compiled"]:
        network.compile()
    kind = torch.get_default_device().type
    with torch.inference_mode(), torch.autocast(kind, torch.bfloat16, enabled=autocast):
        times = {"pass_ms": quantiles(milliseconds(PASSES * steps, lambda: network(*given)))}
    if config["model"]["architecture"] == "robomorph" or kind != "cpu":
        return times
    model = TrainedModel(network, {**config, "normalizer": "context"})
    u = np.random.randn(1, config["samples"], 7).astype(np.float32)
    y = np.random.randn(1, config["context"], 7).astype(np.float32)
    for name, kind, passes, count in [("ddim_5_ms", "ddim", 5, CHAINS), ("ddpm_100_ms", "ddpm", 100, 1)]:
        if passes > config["model"]["diffusion"]["steps"]:
            continue
        sampler = {"kind": kind, "steps": passes}
        action = lambda sampler=sampler: model.predict(u, y, sampler=sampler)  # noqa: E731
        with torch.autocast("cpu", torch.bfloat16, enabled=autocast):
            times[name] = quantiles(milliseconds(count * steps, action))
    return times


def main() -> None:
    question = json.load(sys.stdin)
    torch.set_num_threads(question["threads"])
    torch.set_default_device(question.get("device", "cpu"))
    torch.backends.cuda.matmul.allow_tf32 = question.get("tf32", False)
    measure = {"training": training, "inference": inference}[question["what"]]
    times = measure(network_of(question["config"]), question)
    print(json.dumps({"version": torch.__version__, "times": times}))


if __name__ == "__main__":
    main()

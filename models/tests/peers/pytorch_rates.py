"""Times networks of torqued and their PyTorch twins in turns, so that what else the machine does
falls on both, and prints the ratios of medians. `rates` is `models/examples/model_rates.rs`, built.

    pip install ../../../python && python pytorch_rates.py RATES [--rounds N] [--json FILE] PRESET ..

PyTorch runs eagerly, in single precision, at as many threads. Its step is noise, forward, loss,
backward, Adam; its pass is one of the network under `inference_mode`.
"""

import argparse
import json
import resource
import statistics
import subprocess
import sys
import time

import torch
import torch.nn.functional as F
from torqued.checkpoint import network_of

BATCH = 64


def milliseconds(count: int, action) -> float:
    action()
    times = []
    for _ in range(count):
        start = time.perf_counter()
        action()
        times.append(1e3 * (time.perf_counter() - start))
    return statistics.median(times)


def inputs(network: torch.nn.Module, config: dict, batch: int) -> list[torch.Tensor]:
    samples, context = config["samples"], config["context"]
    if config["model"]["architecture"] == "robomorph":
        return [torch.randn(batch, context, 14), torch.randn(batch, samples - context, 7)]
    levels = torch.randint(config["model"]["diffusion"]["steps"], (batch,))
    return [torch.randn(batch, samples, network.channels), levels, torch.randn(batch, samples, 7)]


def measure(config: dict, steps: int) -> dict:
    network = network_of(config)
    optimizer = torch.optim.Adam(network.parameters(), lr=6e-4)
    given = inputs(network, config, BATCH)
    with torch.no_grad():
        target = torch.randn_like(network(*given))
    noise = torch.empty_like(given[0])

    def step():
        optimizer.zero_grad(set_to_none=True)
        F.mse_loss(network(given[0] + noise.normal_(), *given[1:]), target).backward()
        optimizer.step()

    one = inputs(network, config, 1)

    @torch.inference_mode()
    def forward():
        network(*one)

    step_ms = milliseconds(steps, step)
    network.eval()
    pass_ms = milliseconds(10 * steps, forward)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"step_ms": step_ms, "pass_ms": pass_ms, "peak_memory_mib": peak}


def answer(command: list[str], **options) -> list | dict:
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, **options).stdout)


def compare(rates: str, preset: str, rounds: int, steps: int) -> dict:
    ours, theirs = [], []
    for _ in range(rounds):
        ours += answer([rates, "--json", "--steps", str(steps), preset])
        question = json.dumps({**ours[-1], "steps": steps}).encode()
        # A process of its own, since memory is measured by its peak.
        theirs.append(answer([sys.executable, __file__, "--twin"], input=question))
    row = {"preset": preset, "threads": ours[0]["threads"], "pytorch": torch.__version__}
    for key in ("step_ms", "pass_ms", "peak_memory_mib"):
        mine, other = (statistics.median(each[key] for each in side) for side in (ours, theirs))
        row[key] = {"ours": mine, "pytorch": other, "ratio": mine / other}
    return row


def main() -> None:
    if sys.argv[1:] == ["--twin"]:
        question = json.load(sys.stdin)
        torch.set_num_threads(question["threads"])
        print(json.dumps(measure(question["config"], question["steps"])))
        return
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rates")
    parser.add_argument("presets", nargs="+")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--steps", type=int, default=3)
    parser.add_argument("--json")
    arguments = parser.parse_args()
    print(f"PyTorch {torch.__version__}; ours, PyTorch's, ratio")
    rows = []
    for preset in arguments.presets:
        row = compare(arguments.rates, preset, arguments.rounds, arguments.steps)
        rows.append(row)
        texts = [
            f"{name} {row[key]['ours']:9.1f} {row[key]['pytorch']:9.1f} {unit} {row[key]['ratio']:5.2f}"
            for name, key, unit in (("step", "step_ms", "ms"), ("pass", "pass_ms", "ms"), ("memory", "peak_memory_mib", "MiB"))
        ]
        print(f"{preset:18}", *texts, sep="   ", flush=True)
    if arguments.json:
        with open(arguments.json, "w") as file:
            json.dump(rows, file, indent=1)


main()

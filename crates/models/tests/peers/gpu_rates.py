"""Measures training steps on a GPU, ours and PyTorch's in one session, and prints one table.

    python crates/models/tests/peers/gpu_rates.py MODEL_RATES [PRESET ..]

MODEL_RATES is the program `model_rates` of this crate, built with the feature `torch` and this Python's version of PyTorch
(docs/devices.md). LD_LIBRARY_PATH must contain PyTorch's libraries, and PYTHONPATH the repository's `python`. A row has the
medians in ms and the peak memory of tensors in MiB: in f32 as PyTorch computes by default (TF32 in convolutions), with TF32
in products too, and with bf16 products. Both sides are measured three times in turn, and the table has the median of the
medians.
"""

import gc
import json
import statistics
import subprocess
import sys

import torch
from pytorch_rates import training
from torqued.checkpoint import network_of

PAPER = ["robomorph-paper", "diffuser-paper", "cdcnn-paper", "cdt-paper"]
SMALL = ["robomorph-small", "diffuser-small", "cdcnn-small", "cdt-small"]
# Convolutions have no bf16 in torqued.
BF16 = {"robomorph", "cdt"}
ROUNDS, STEPS, BATCH = 3, 20, 64


def ours(program: str, device: str, presets: list[str], precision: str | None = None) -> dict[str, dict]:
    chosen = ["--matmul-precision", precision] if precision else []
    command = [program, "training", "--json", "--device", device, "--steps", str(STEPS), *chosen, *presets]
    answer = subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout
    return {entry["preset"]: entry for entry in json.loads(answer)}


def theirs(config: dict, tf32: bool, autocast: bool) -> dict:
    torch.backends.cuda.matmul.allow_tf32 = tf32
    torch.cuda.reset_peak_memory_stats()
    question = {"config": config, "steps": STEPS, "batch": BATCH, "compiled": False, "autocast": autocast}
    times = training(network_of(config), question)
    gc.collect()
    torch.cuda.empty_cache()
    return times


def main() -> None:
    program, presets = sys.argv[1], sys.argv[2:] or PAPER + SMALL
    torch.set_default_device("cuda")
    variants = [("f32", "torch", None, False, False), ("tf32", "torch-tf32", None, True, False)]
    variants.append(("bf16", "torch-tf32", "bf16", True, True))
    found: dict[tuple, list] = {}
    for _ in range(ROUNDS):
        for name, device, precision, tf32, autocast in variants:
            asked = [preset for preset in presets if not precision or preset.split("-")[0] in BF16]
            for preset, entry in ours(program, device, asked, precision).items():
                peer = theirs(entry["config"], tf32, autocast)
                found.setdefault((preset, name), []).append((entry["times"], peer))
    print(torch.__version__, torch.version.cuda, torch.cuda.get_device_name())
    print("| step of 64 trajectories | | torqued, ms | PyTorch, ms | ratio | torqued, MiB | PyTorch, MiB |")
    print("|---|---|---|---|---|---|---|")
    for (preset, name), rounds in found.items():
        median = lambda side, key: statistics.median(pair[side][key] for pair in rounds)  # noqa: E731
        ms = [median(side, "step_ms") for side in (0, 1)]
        mib = [median(side, "peak_device_memory_mib") for side in (0, 1)]
        print(
            f"| `{preset}` | {name} | {ms[0]:.1f} | {ms[1]:.1f} | {ms[0] / ms[1]:.2f} | {mib[0]:.0f} | {mib[1]:.0f} |"
        )


if __name__ == "__main__":
    main()

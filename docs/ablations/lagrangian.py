"""Trains the `lagrangian` with one part left out at a time, and prints the errors of these variants as a table.

    torqued serve --data /tmp/ablations --listen 127.0.0.1:7191 &
    torqued submit --watch --server http://127.0.0.1:7191 docs/ablations/lagrangian.json
    PYTHONPATH=python python docs/ablations/lagrangian.py --server http://127.0.0.1:7191

Needs torch, numpy, safetensors and polars. torqued simulates the robots and evaluates ARX, which is the last row.
This script trains the models of all other rows in one thread, as variants of the PyTorch twin. Their loss has no score
of draws, because only `doubt` gets a gradient from it, and no prediction here uses `doubt`.
"""

import argparse
import json
import math
import sys
import time
import urllib.request
from collections.abc import Callable
from functools import partial

import numpy as np
import polars
import torch
from torch import Tensor

from torqued.lagrangian import Lagrangian, Motions
from variants import MassesHeldAtZero, NoFit, NoPositiveDefiniteness, NoQuadraticTerms, NoStructure, shares

CONTEXT, SAMPLES, JOINTS, RATE_HZ = 320, 400, 7, 60.0
TRAINED_ON, HELD_OUT = 4500, 500
"""Trajectories, as torqued divides 5000 with `validation_fraction` 0.1."""
SEEN = {("chirp", 0.3), ("multisine", 0.15)}
"""Cells in distribution: the families and frequencies in Hz of D1."""
BATCH, WARMUP, FINAL_RATIO, BETAS = 48, 100, 0.001, (0.9, 0.99)
"""As in docs/lagrangian.md."""
DIVERGED_DEG = 180.0
RESAMPLES = 2000
"""Both as in torqued's reports."""

VARIANTS: dict[str, tuple[Callable[..., torch.nn.Module], float]] = {
    "complete": (Lagrangian, 3e-3),
    "masses held at 0": (MassesHeldAtZero, 3e-3),
    "no positive definiteness": (NoPositiveDefiniteness, 3e-3),
    "no quadratic terms": (NoQuadraticTerms, 3e-3),
    "no fit": (NoFit, 3e-3),
    "no structure": (NoStructure, 3e-3),
    "no structure, network alone": (partial(NoStructure, terms=38, own=False), 3e-3),
}
"""Each with its highest learning rate."""

Cell = tuple[str, float]
"""Family and frequency, Hz."""


class Pipeline:
    """The newest finished pipeline `ablations` of a server."""

    def __init__(self, server: str):
        self.server = server
        jobs = self.get("/v1/jobs?kind=pipeline&state=succeeded")["jobs"]
        self.members = {
            member["name"]: self.get(f"/v1/jobs/{member['job']}")
            for member in next(job for job in jobs if job["name"] == "ablations")["members"]
        }

    def get(self, path: str) -> dict:
        with urllib.request.urlopen(self.server + path) as answer:
            return json.load(answer)

    def table(self, job: str, content: str) -> polars.DataFrame:
        """The rows of all files of a dataset whose content is `content`."""
        dataset = self.get(f"/v1/datasets/{self.members[job]['dataset']}")
        urls = [self.server + file["url"] for file in dataset["files"] if file["content"] == content]
        return polars.concat(polars.read_parquet(urllib.request.urlopen(url).read()) for url in urls)

    def trajectories(self, job: str) -> tuple[Tensor, Tensor]:
        """Torques in N·m and positions in rad, each [trajectory, sample, joint]."""
        steps = self.table(job, "trajectories").sort("trajectory", "step")
        u, q = (steps.select(f"{name}{joint}" for joint in range(1, JOINTS + 1)) for name in "uq")
        return tuple(torch.tensor(each.to_numpy()).float().reshape(-1, SAMPLES, JOINTS) for each in (u, q))

    def cells(self, job: str) -> list[Cell]:
        """The cell of each trajectory."""
        robots = self.table(job, "robots").sort("trajectory")
        return list(robots.select("family", "frequency_hz").iter_rows())

    def scores(self, job: str, predictor: str) -> tuple[np.ndarray, float]:
        """The same as the function `scores`, for a predictor of a finished evaluation."""
        evaluation = self.get(f"/v1/evaluations/{self.members[job]['id']}")
        (url,) = [file["url"] for file in evaluation["artifacts"] if file["name"] == "scenarios.parquet"]
        scenarios = polars.read_parquet(urllib.request.urlopen(self.server + url).read()).filter(predictor=predictor)
        rmse = scenarios.group_by("trajectory").agg(polars.col("rmse_deg").mean()).sort("trajectory")["rmse_deg"]
        diverged = [
            cell["scenarios"] * rollouts["diverged"]
            for cell in evaluation["report"]["cells"]
            for rollouts in cell["rollouts"]
            if rollouts["predictor"] == predictor
        ]
        return rmse.to_numpy()[None], sum(diverged) / len(rmse)


def train(model: torch.nn.Module, peak: float, steps: int, robots: int, u: Tensor, y: Tensor) -> None:
    """Trains on the first `robots` with Adam. The learning rate has a warmup and half a cosine, as in torqued."""

    def learning_rate(done: int) -> float:
        if done < WARMUP:
            return (done + 1) / WARMUP
        cosine = 0.5 * (1 + math.cos(math.pi * (done - WARMUP) / max(steps - WARMUP, 1)))
        return FINAL_RATIO + (1 - FINAL_RATIO) * cosine

    learned = [parameter for parameter in model.parameters() if parameter.requires_grad]
    optimizer = torch.optim.Adam(learned, lr=peak, betas=BETAS)
    schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, learning_rate)
    held_out = [series[TRAINED_ON : TRAINED_ON + HELD_OUT] for series in (u, y)]
    losses: list[float] = []
    batches: list[Tensor] = []
    started = time.monotonic()
    for step in range(1, steps + 1):
        if not batches:
            batches = [batch for batch in torch.randperm(robots).split(BATCH) if len(batch) == BATCH]
        batch = batches.pop()
        loss = unscored_loss(model, u[batch], y[batch])
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        losses.append(loss.item())
        if step % max(steps // 10, 1) == 0:
            with torch.no_grad():
                unseen = unscored_loss(model, *held_out).item()
            mean, seconds = np.mean(losses), time.monotonic() - started
            say(f"  step {step}: loss {mean:.4f}, held out {unseen:.4f}, {seconds:.0f} s")
            losses.clear()


def unscored_loss(model: torch.nn.Module, u: Tensor, y: Tensor) -> Tensor:
    """The loss without the score of draws."""
    none = torch.zeros(len(u), dtype=torch.bool)
    return model.loss(u, y[:, :CONTEXT], y[:, CONTEXT:], chosen=none, normals=torch.empty(len(u), 0))


def scores(truth: Tensor, answers: list[Tensor]) -> tuple[np.ndarray, float]:
    """RMSE in degrees [seed, trajectory], and the share that diverged. Positions are [trajectory, sample, joint]."""
    errors = np.degrees((torch.stack(answers).double() - truth.double()).numpy())
    diverged = ~(np.abs(errors) <= DIVERGED_DEG).all((2, 3))
    return np.sqrt(np.square(errors).mean(2)).mean(2), diverged.mean()


def row(name: str, rmse: np.ndarray, diverged: float, cells: list[Cell]) -> str:
    """A line of the table. `rmse` is in degrees, [seed, trajectory]."""
    of_cell = {cell: rmse[:, [each == cell for each in cells]] for cell in sorted(set(cells))}
    columns = [name]
    of_seeds = []
    for seen in (True, False):
        group = [values for cell, values in of_cell.items() if (cell in SEEN) == seen]
        columns.append(interval([values.mean(0) for values in group]))
        means = np.mean([values.mean(1) for values in group], axis=0)
        of_seeds.append(" to ".join(dict.fromkeys([short(means.min()), short(means.max())])))
    columns += [", ".join(of_seeds), f"{100 * diverged:.2g} %"]
    family, frequency = worst = max(of_cell, key=lambda cell: of_cell[cell].mean())
    columns.append(f"{family} {frequency:g} Hz: {short(of_cell[worst].mean())}")
    return f"| {' | '.join(columns)} |"


def interval(of_cells: list[np.ndarray]) -> str:
    """The mean over cells with its 95 % bootstrap interval. Robots are resampled within each cell."""
    generator = np.random.default_rng(0)
    drawn = [values[generator.integers(len(values), size=(RESAMPLES, len(values)))].mean(1) for values in of_cells]
    low, high = np.quantile(np.mean(drawn, axis=0), [0.025, 0.975])
    return f"{short(np.mean([values.mean() for values in of_cells]))} [{short(low)}, {short(high)}]"


def short(number: float) -> str:
    """Two digits, and no exponent."""
    return f"{number:.0f}" if number >= 10 else f"{number:#.2g}".rstrip(".")


def say(message: str) -> None:
    print(message, file=sys.stderr, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--server", default="http://127.0.0.1:7191")
    parser.add_argument("--steps", type=int, default=5000, help="steps of each training")
    parser.add_argument("--robots", type=int, default=TRAINED_ON, help=f"robots to train on, {BATCH} to {TRAINED_ON}")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2], help="seeds of weights, batches and points")
    parser.add_argument("--variants", nargs="+", default=list(VARIANTS), choices=list(VARIANTS), metavar="VARIANT")
    asked = parser.parse_args()
    if not BATCH <= asked.robots <= TRAINED_ON:
        parser.error(f"--robots is {asked.robots}, allowed are {BATCH} to {TRAINED_ON}")
    torch.set_num_threads(1)
    pipeline = Pipeline(asked.server)
    u, y = pipeline.trajectories("train-set")
    u_test, y_test = pipeline.trajectories("test-grid")
    cells = pipeline.cells("test-grid")
    print("| variant | in distribution | out | seeds, in and out | diverged | worst cell |")
    print("|---|---|---|---|---|---|")
    for name in asked.variants:
        answers = []
        for seed in asked.seeds:
            say(f"{name}, {asked.steps} steps, seed {seed}")
            torch.manual_seed(seed)
            variant, peak = VARIANTS[name]
            model = variant(context=CONTEXT, rate_hz=RATE_HZ)
            if isinstance(model, NoStructure):
                model.measure(Motions.of(u[: asked.robots], y[: asked.robots, :CONTEXT], RATE_HZ))
            train(model, peak, asked.steps, asked.robots, u, y)
            with torch.inference_mode():
                answers.append(model.answer(u_test, y_test[:, :CONTEXT]))
                if not isinstance(model, NoStructure):
                    negative, indefinite = shares(model, u_test, y_test, CONTEXT)
                    say(f"  robots with a negative mass {negative:.2%}, an indefinite mass matrix {indefinite:.2%}")
        print(row(name, *scores(y_test[:, CONTEXT:], answers), cells), flush=True)
    print(row("ARX", *pipeline.scores("evaluate", "arx"), cells))


if __name__ == "__main__":
    main()

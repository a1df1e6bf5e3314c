"""Measures the steps that MuJoCo needs for the trajectories of a dataset, and its speed. Prints JSON.

    python tests/peers/mujoco_rates.py accuracy FOLDER
    python tests/peers/mujoco_rates.py rates FOLDER --substeps N

`accuracy` finds the smallest number of classical Runge-Kutta steps per sample with a 99th percentile of errors
below 1e-4 rad, compared with 64 steps. It also prints this percentile for the recorded trajectories. `rates`
measures steps and whole trajectories per second on one and on two threads. Only time inside MuJoCo's C library
counts. Models are compiled before.
"""

import argparse
import json
import threading
import time

import mujoco
import numpy as np
from mujoco import rollout

import datasets
import mujoco_arm

ALLOWED = 1e-4
CANDIDATES = [4, 5, 6, 7, 8, 10, 12, 16, 24, 32]
REFERENCE = 64
STEPS = 100_000
TRAJECTORIES = {"accuracy": 128, "rates": 64}


class Drive:
    """Simulates robots of a dataset again with Runge-Kutta steps."""

    def __init__(self, pairs):
        self.pairs = pairs
        self.u = np.array([recorded.u for _, recorded in pairs])

    def trajectories(self, substeps, threads):
        """Positions [trajectory, sample, joint] in rad, and the seconds for them."""
        models = [
            mujoco_arm.model(robot, "RK4", 1 / robot.rate_hz / substeps) for robot, _ in self.pairs
        ]
        data = [mujoco.MjData(models[0]) for _ in range(threads)]
        physics = mujoco.mj_stateSize(models[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)
        initial = np.zeros((len(models), physics))
        for state, (robot, _) in zip(initial, self.pairs):
            state[1:15] = *robot.q0, *robot.qd0
        held = np.repeat(self.u, substeps, axis=1)
        with rollout.Rollout(nthread=threads if threads > 1 else 0) as pool:
            start = time.perf_counter()
            states, _ = pool.rollout(
                models,
                data,
                initial_state=initial,
                control=held,
                control_spec=mujoco.mjtState.mjSTATE_QFRC_APPLIED,
            )
            seconds = time.perf_counter() - start
        # The states are those after each step. The last one lies beyond the last sample.
        after = states[:, substeps - 1 :: substeps, 1:8][:, :-1]
        return np.concatenate([initial[:, None, 1:8], after], axis=1), seconds


def p99(q, reference):
    errors = np.nan_to_num(np.abs(q - reference).max(axis=(1, 2)), nan=np.inf)
    return float(np.quantile(errors, 0.99, method="higher"))


def accuracy(pairs):
    drive = Drive(pairs)
    reference, _ = drive.trajectories(REFERENCE, 2)
    tried = {}
    for substeps in CANDIDATES:
        tried[substeps] = p99(drive.trajectories(substeps, 2)[0], reference)
        if tried[substeps] < ALLOWED:
            break
    else:
        raise SystemExit(f"no number of Runge-Kutta steps is accurate enough: {tried}")
    return {
        "substeps": substeps,
        "p99_rad": tried[substeps],
        "tried_p99_rad": tried,
        "recorded_p99_rad": p99(np.array([recorded.q for _, recorded in pairs]), reference),
    }


def steps_per_second(robot, torque, threads):
    """Rate of `mj_step` with the integrator that is implicit in damping. The threads share a model."""
    model = mujoco_arm.model(robot, "implicitfast", 0.002)
    all_data = [mujoco.MjData(model) for _ in range(threads)]
    for data in all_data:
        data.qpos[:] = robot.q0
        data.qfrc_applied[:] = torque
        mujoco.mj_step(model, data, STEPS // 50)
    workers = [
        threading.Thread(target=mujoco.mj_step, args=(model, data, STEPS)) for data in all_data
    ]
    start = time.perf_counter()
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    return threads * STEPS / (time.perf_counter() - start)


def rates(pairs, substeps):
    drive = Drive(pairs)
    robot, recorded = pairs[0]
    return {
        "steps_per_s": [steps_per_second(robot, recorded.u[0], threads) for threads in (1, 2)],
        "trajectories_per_s": [
            len(pairs) / drive.trajectories(substeps, threads)[1] for threads in (1, 2)
        ],
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("what", choices=list(TRAJECTORIES))
    parser.add_argument("folder", metavar="FOLDER")
    parser.add_argument("--substeps", type=int)
    arguments = parser.parse_args()
    # Steps that are too long diverge, and the search must find them.
    mujoco.set_mju_user_warning(lambda _: None)
    pairs = datasets.read(arguments.folder, TRAJECTORIES[arguments.what])
    if arguments.what == "accuracy":
        found = accuracy(pairs)
    else:
        if arguments.substeps is None:
            parser.error("rates needs --substeps")
        found = rates(pairs, arguments.substeps)
    print(json.dumps({"version": mujoco.__version__, **found}))


if __name__ == "__main__":
    main()

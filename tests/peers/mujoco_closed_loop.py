"""Measures how fast MuJoCo steps an arm of `panda-real` with the control periods of its controller. Prints JSON.

    TORQUED=target/release/torqued python tests/peers/mujoco_closed_loop.py [PAIRS]

Only time inside MuJoCo's C library counts: its controller would come on top. One thread, the arm of a drawn robot, one step per
control period. torqued simulates and writes nothing, on one thread (`cargo run --release -p dynamics --example rates -- SPEC 1`).
The two take turns PAIRS times (5).
"""

import json
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

import mujoco
import numpy
from mujoco import rollout

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "readers"))
import test_closed_loop as closed_loop  # noqa: E402

CONTROL_HZ, SAMPLES, SETTLING, PERIODS = 1020, 400, 30, 17
STEPS = (SAMPLES + SETTLING) * PERIODS
INTEGRATORS = {"RK4": mujoco.mjtIntegrator.mjINT_RK4, "Euler": mujoco.mjtIntegrator.mjINT_EULER}
QUIET = {"position_noise_rad": 0, "position_resolution_rad": 0, "torque_noise_nm": 0}


def mujoco_rate(model, integrator):
    """Trajectories per second."""
    model.opt.integrator, model.opt.timestep = INTEGRATORS[integrator], 1 / CONTROL_HZ
    data = mujoco.MjData(model)
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = numpy.zeros((1, mujoco.mj_stateSize(model, full)))
    mujoco.mj_getState(model, data, state[0], full)
    start = time.perf_counter()
    rollout.rollout(model, data, state, nstep=STEPS)
    return 1 / (time.perf_counter() - start)


def torqued_rate(spec):
    """Trajectories per second on the instructions in use."""
    words = [ROOT / "target/release/examples/rates", "--json", spec, "1"]
    ran = subprocess.run(words, capture_output=True, text=True, check=True)
    return next(rates["trajectories_per_s"] for rates in json.loads(ran.stdout) if rates["precision"] == "f32")


def main(pairs):
    _, robots = closed_loop.simulated({"trajectories": 1, "samples": 20})
    model = closed_loop.panda(robots.row(0, named=True))
    with tempfile.TemporaryDirectory() as folder:
        found = {name: [] for name in [*INTEGRATORS, "torqued", "torqued with noise"]}
        for _ in range(pairs):
            for name, observations in [("torqued", {"observations": QUIET}), ("torqued with noise", {})]:
                path = pathlib.Path(folder) / "spec.json"
                path.write_text(json.dumps({"preset": "panda-real", **observations}))
                found[name].append(torqued_rate(path))
            for name in INTEGRATORS:
                found[name].append(mujoco_rate(model, name))
    medians = {name: statistics.median(rates) for name, rates in found.items()}
    ratios = {name: medians["torqued"] / medians[name] for name in INTEGRATORS}
    print(json.dumps({"mujoco": mujoco.__version__, "trajectories_per_s": medians, "torqued_over": ratios}, indent=1))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)

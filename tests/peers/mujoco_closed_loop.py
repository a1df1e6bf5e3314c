"""Measures torqued beside MuJoCo on arms of `panda-real` under each controller. Prints JSON.

    TORQUED=target/release/torqued python tests/peers/mujoco_closed_loop.py [TURNS] [ROW...]

torqued, MuJoCo alone, and MuJoCo with the same controller take TURNS turns (9) on one thread. The rows are those of ROWS (all).

torqued simulates and writes nothing, in memory that it uses again (`cargo build --release -p dynamics --example rates`). MuJoCo moves
the arm of one drawn robot, one step per control period, without friction. The program that steps it is mujoco_closed_loop.cpp, which
is compiled here for this processor: from Python, MuJoCo reads a clock several times per step, which takes a third of its time. The
controller beside it calls only the stages of MuJoCo that its law needs, and its reference costs nothing. Before a controller is
measured, its torques at random states are compared with the law in Python.
"""

import json
import pathlib
import statistics
import subprocess
import sys
import tempfile

import mujoco
import numpy

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "readers"))
import test_closed_loop as closed_loop  # noqa: E402

CONTROL_HZ, RATE_HZ, SAMPLES, SETTLING, PERIODS = 1020, 60, 400, 30, 17
QUIET = {"position_noise_rad": 0, "position_resolution_rad": 0, "torque_noise_nm": 0}
EXACT = {f"{part}_fraction": 0 for part in ["mass", "com", "inertia", "armature", "geometry"]}
LAWS = {**closed_loop.LAWS, "joint-pd": None, "computed-torque": {}}
ON_PATHS = " along hand_paths"
ROWS = [*LAWS, *(law + ON_PATHS for law in ["joint-pd", *closed_loop.HAND_LAWS])]
INTEGRATORS = ["RK4", "Euler"]
# The controller of `panda-real`.
VELOCITY_CUTOFF_HZ, TORQUE_RATE_NM_S, TORQUES_NM = 50, 1000, [87, 87, 87, 87, 12, 12, 12]
# Of the program's torques, as a share of the largest at a state.
LARGEST_ERROR = 1e-9
# MuJoCo's arm has no friction, but its controller should not lose it.
LOST_RAD = 0.5


def spec_of(row, **fields):
    """Fields of `panda-real` with the law of a row, without noise."""
    law = row.removesuffix(ON_PATHS)
    spec = {"observations": QUIET, **fields}
    if LAWS[law] is not None:
        spec["controller"] = {"law": {law: LAWS[law]}}
    if row.endswith(ON_PATHS):
        families = dict.fromkeys(["fourier", "point_to_point", "via_points"])
        spec["excitation"] = {**families, **closed_loop.HAND_PATHS}
    return spec


def compiled(folder):
    """The program that moves MuJoCo's arm with a controller, compiled for this processor."""
    package = pathlib.Path(mujoco.__file__).parent
    library = next(package.glob("libmujoco.so*"))
    source = pathlib.Path(__file__).with_suffix(".cpp")
    flags = ["-std=c++20", "-O3", "-march=native", "-DNDEBUG", "-isystem", package / "include"]
    program = folder / "mujoco_closed_loop"
    subprocess.run(["g++", *flags, source, library, f"-Wl,-rpath,{package}", "-o", program], check=True)
    return program


def written(values):
    """Numbers as the program reads them."""
    return " ".join(map(repr, numpy.ravel(values).astype(float).tolist()))


def bias_forces(model, data, q, qd):
    data.qpos[:], data.qvel[:] = q, qd
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    return data.qfrc_bias.copy()


class Peer:
    """An arm of MuJoCo and its controller, with what a drawn robot of a law does."""

    def __init__(self, program, folder, law):
        self.program, self.law = program, law
        rows, robots = closed_loop.simulated(spec_of(law, trajectories=1))
        _, nominal = closed_loop.simulated(spec_of(law, trajectories=1, samples=20, robot={**EXACT, "payload": None}))
        self.robot, self.nominal = robots.row(0, named=True), nominal.row(0, named=True)
        self.gains = json.loads(self.robot["controller"])
        self.reference = json.loads(self.robot["reference"])
        models = {"arm": closed_loop.panda(self.robot), "known": closed_loop.panda(self.nominal, with_damping=False)}
        self.models = {name: folder / f"{law}-{name}.mjb" for name in models}
        for name, model in models.items():
            mujoco.mj_saveModel(model, str(self.models[name]))
        self.known = models["known"]
        gains = [self.gains.get(name, 0) for name in ["kp", "kd", "ki", "kn", "dn"]]
        self.controller = "\n".join(map(written, [self.nominal["flange"], *gains]))

    def torques(self, states):
        """Those of the program at states (q, v, r, ṙ, r̈)."""
        answer = self.run("torques", self.models["known"], self.law, numbers=[len(states), states])
        return numpy.array([line.split() for line in answer.splitlines()], dtype=float)

    def expected(self, q, v, *course):
        """The torques of the law in Python."""
        data = mujoco.MjData(self.known)
        bias = lambda qd: bias_forces(self.known, data, q, qd)
        if self.law in closed_loop.HAND_LAWS:
            hand = closed_loop.Hand(self.known, data, self.nominal["flange"])
            torques = closed_loop.hand_torques(self.law, self.gains, hand, course, q, v)
            return torques + bias(v if self.law == "operational-space" else 0 * q)
        kp, kd = numpy.array(self.gains["kp"]), numpy.array(self.gains["kd"])
        wish = kp * (course[0] - q) + kd * (course[1] - v)
        if self.law == "joint-pd":
            return wish + bias(0 * q)
        torques, matrix = bias(v), numpy.zeros((7, 7))
        mujoco.mj_fullM(self.known, data, matrix)
        return torques + matrix @ (course[2] + wish)

    def check(self, states=200):
        """The largest error of the program's torques, relative to the largest torque of the state."""
        random = numpy.random.default_rng(1)
        # Postures around the middle of the joints' ranges.
        q = numpy.array([0, 0, 0, -1.57, 0, 1.87, 0]) + random.uniform(-0.8, 0.8, (states, 7))
        r = q + random.uniform(-0.1, 0.1, (states, 7))
        v, rd, rdd = (random.uniform(-scale, scale, (states, 7)) for scale in (1, 1, 3))
        found = self.torques(numpy.stack([q, v, r, rd, rdd], axis=1))
        expected = numpy.array([self.expected(*state) for state in zip(q, v, r, rd, rdd)])
        error = numpy.max(numpy.abs(found - expected) / numpy.max(numpy.abs(expected), axis=1, keepdims=True))
        if not error < LARGEST_ERROR:
            raise ValueError(f"the torques of {self.law} differ from those in Python by {error:.1e} of the largest")
        return error

    def flight(self):
        """What the program needs to move the arm along the drawn reference."""
        at = lambda sample: closed_loop.reference_at(self.reference, sample / RATE_HZ)
        plans = [closed_loop.planned(at(sample), at(sample + 1), 1 / RATE_HZ).T for sample in range(SETTLING + SAMPLES)]
        ratio = 2 * numpy.pi * VELOCITY_CUTOFF_HZ / CONTROL_HZ
        constants = [RATE_HZ, CONTROL_HZ, ratio / (1 + ratio), TORQUE_RATE_NM_S / CONTROL_HZ, *TORQUES_NM]
        start = [self.robot[f"{name}_{joint}"] for name in ["q0", "qd0"] for joint in range(1, 8)]
        return [constants, start, self.gains["delay_periods"], len(plans), plans]

    def rate(self, flight, integrator, controlled):
        """Trajectories per second, with the controller or without it."""
        words = ["rate", self.models["arm"], self.models["known"], self.law, integrator]
        answer = json.loads(self.run(*words, *([] if controlled else ["alone"]), numbers=flight))
        if controlled and not answer["largest_error_rad"] < LOST_RAD:
            raise ValueError(f"MuJoCo's arm lost its reference under {self.law}: {answer}")
        return answer["trajectories_per_s"]

    def run(self, *words, numbers):
        text = "\n".join([self.controller, *map(written, numbers)])
        return subprocess.run([self.program, *words], input=text, stdout=subprocess.PIPE, text=True, check=True).stdout


def torqued_rate(spec):
    """Trajectories per second on the instructions in use."""
    words = [ROOT / "target/release/examples/rates", "--json", spec, "f32", "1"]
    ran = subprocess.run(words, capture_output=True, text=True, check=True)
    return json.loads(ran.stdout)[0]["trajectories_in_used_memory_per_s"]


def turn(peers, folder, rows):
    """The rates of one turn: of torqued by row, and of MuJoCo by law, integrator and whether the controller counts."""
    rates = {}
    for row in rows:
        path = folder / "spec.json"
        path.write_text(json.dumps({"preset": "panda-real", **spec_of(row)}))
        rates[row] = torqued_rate(path)
    for law, (peer, flight) in peers.items():
        for integrator in INTEGRATORS:
            for controlled in [False, True]:
                rates[law, integrator, controlled] = peer.rate(flight, integrator, controlled)
    return rates


def main(turns, rows):
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        program = compiled(folder)
        laws = dict.fromkeys(row.removesuffix(ON_PATHS) for row in rows)
        peers = {law: Peer(program, folder, law) for law in laws}
        errors = {law: peer.check() for law, peer in peers.items()}
        peers = {law: (peer, peer.flight()) for law, peer in peers.items()}
        found = [turn(peers, folder, rows) for _ in range(turns)]
    table = {}
    for statistic, of in [("fastest", max), ("median", statistics.median)]:
        rates = {key: of([rates[key] for rates in found]) for key in found[0]}
        # All laws move the same arm where the controller does not count.
        alone = {name: of([rates[law, name, False] for rates in found for law in laws]) for name in INTEGRATORS}
        table[statistic] = {row: described(rates, row, alone) for row in rows}
    versions = {"mujoco": mujoco.__version__, "turns": turns, "torque_errors": errors}
    print(json.dumps({**versions, **table}, indent=1))


def described(rates, row, alone):
    law = row.removesuffix(ON_PATHS)
    line = {"torqued": rates[row]}
    for name in INTEGRATORS:
        controlled = rates[law, name, True]
        line[name] = {"mujoco": alone[name], "mujoco_controlled": controlled}
        line[name] |= {"ratio": rates[row] / alone[name], "ratio_controlled": rates[row] / controlled}
    return line


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 9, sys.argv[2:] or ROWS)

"""Arms under a controller, beside MuJoCo.

MuJoCo gets each robot from the table of robots, and a controller that is written here from docs/closed-loop.md. Nothing of
torqued's lanes is used.
"""

import json
import os
import subprocess
import tempfile
import unittest

import mujoco
import numpy
import polars
from product import TORQUED

TRAJECTORIES = 9
# MuJoCo's steps per control period.
STEPS = 4
LAWS = {
    "joint-pd": {"stiffness_nm_rad": [600, 600, 600, 600, 250, 150, 50], "damping_nm_s_rad": [50, 50, 50, 20, 20, 20, 10]},
    "computed-torque": {"natural_frequency_hz": [2, 4], "integral_per_s": [0, 0.5]},
    "operational-space": {},
    "cartesian-impedance": {},
}
# References of controllers of the hand.
HAND_LAWS = ["operational-space", "cartesian-impedance"]
HAND_PATHS = {"hand_paths": {"frequency_hz": {"uniform": [0.2, 0.6]}}}
ENVIRONMENT = {**os.environ, "TORQUED_CONFIG": os.devnull}


def simulated(fields):
    """The tables of trajectories and of robots of `panda-real` with other fields."""
    with tempfile.TemporaryDirectory() as folder:
        spec = {"preset": "panda-real", **fields}
        words = [TORQUED, "simulate", "--spec", "-", "--out", folder]
        ran = subprocess.run(words, input=json.dumps(spec), capture_output=True, text=True, env=ENVIRONMENT)
        if ran.returncode != 0:
            raise ValueError(ran.stderr)
        read = lambda kind: polars.read_parquet(f"{folder}/{kind}-*.parquet").sort("trajectory")
        return read("trajectories").sort("trajectory", "step"), read("robots")


def panda(robot, with_damping=True):
    """MuJoCo's model of a row of the table of robots."""
    twists = numpy.radians([0, -90, 90, 90, -90, 90, 90])
    text, end = "", ""
    for joint, twist in enumerate(twists, start=1):
        a, d = robot[f"a_{joint}"], robot[f"d_{joint}"]
        place = f"{a!r} {-d * numpy.sin(twist)!r} {d * numpy.cos(twist)!r}".replace("np.float64(", "").replace(")", "")
        turn = f"{float(numpy.cos(twist / 2))!r} {float(numpy.sin(twist / 2))!r} 0 0"
        center = " ".join(repr(robot[f"com_{axis}_{joint}"]) for axis in "xyz")
        inertia = " ".join(repr(robot[f"i{entry}_{joint}"]) for entry in ["xx", "yy", "zz", "xy", "xz", "yz"])
        damping = robot[f"damping_{joint}"] if with_damping else 0.0
        text += f'<body pos="{place}" quat="{turn}">'
        text += f'<joint axis="0 0 1" damping="{damping!r}" armature="{robot[f"armature_{joint}"]!r}"/>'
        text += f'<inertial pos="{center}" mass="{robot[f"mass_{joint}"]!r}" fullinertia="{inertia}"/>'
        end += "</body>"
    gravity = robot["gravity_m_s2"]
    option = f'<option gravity="0 0 {-gravity!r}" integrator="RK4"/>'
    xml = f'<mujoco><compiler balanceinertia="false"/>{option}<worldbody>{text}{end}</worldbody></mujoco>'
    return mujoco.MjModel.from_xml_string(xml)


def reference_at(reference, time):
    """Position, velocity and acceleration of a reference."""
    if "harmonics" in reference:
        r = numpy.array(reference["offset_rad"])
        rd, rdd = numpy.zeros_like(r), numpy.zeros_like(r)
        for number, harmonic in enumerate(reference["harmonics"], start=1):
            w = 2 * numpy.pi * number * reference["frequency_hz"]
            sine, cosine = numpy.array(harmonic["sine_rad"]), numpy.array(harmonic["cosine_rad"])
            s, c = numpy.sin(w * time), numpy.cos(w * time)
            r = r + sine * s + cosine * c
            rd = rd + w * (sine * c - cosine * s)
            rdd = rdd - w * w * (sine * s + cosine * c)
        return r, rd, rdd
    postures, period = numpy.array(reference["postures_rad"]), reference["period_s"]
    moves = "moving" in reference
    k = min(int(time / period), len(postures) - (2 if moves else 4))
    s = (time - k * period) / period
    if moves:
        duration = reference["moving"] * period
        s = min(s / reference["moving"], 1.0)
        course = numpy.polynomial.Polynomial([0, 0, 0, 10, -15, 6])
        distance = postures[k + 1] - postures[k]
        parts = [course.deriv(n)(s) * distance / duration**n for n in range(3)]
        return postures[k] + parts[0], parts[1], parts[2]
    bases = [[1, -3, 3, -1], [4, 0, -6, 3], [1, 3, 3, -3], [0, 0, 0, 1]]
    bases = [numpy.polynomial.Polynomial(base) / 6 for base in bases]
    sums = lambda n: sum(base.deriv(n)(s) * posture for base, posture in zip(bases, postures[k : k + 4])) / period**n
    return sums(0), sums(1), sums(2)


class Hand:
    """The hand of a MuJoCo model, at the flange of its last body."""

    def __init__(self, model, data, flange):
        self.model, self.data, self.flange = model, data, flange

    def pose(self, q, qd=None):
        self.data.qpos[:], self.data.qvel[:] = q, 0 if qd is None else qd
        mujoco.mj_fwdPosition(self.model, self.data)
        mujoco.mj_fwdVelocity(self.model, self.data)
        axes = self.data.xmat[7].reshape(3, 3).copy()
        return self.data.xpos[7] + self.flange * axes[:, 2], axes

    def jacobians(self):
        """J and its derivative, where `pose` was asked for."""
        point = self.data.xpos[7] + self.flange * self.data.xmat[7].reshape(3, 3)[:, 2]
        both = []
        for function in [mujoco.mj_jac, mujoco.mj_jacDot]:
            linear, angular = numpy.zeros((3, 7)), numpy.zeros((3, 7))
            function(self.model, self.data, linear, angular, point, 7)
            both.append(numpy.vstack([linear, angular]))
        return both


def turn(from_, to):
    return 0.5 * sum(numpy.cross(from_[:, axis], to[:, axis]) for axis in range(3))


def place(path, time):
    """Position and velocity of the hand on its path."""
    w, radius, growing = 2 * numpy.pi * path["frequency_hz"], path["radius_m"], 0.0
    if path["shape"] == "spiral":
        growing = -0.4 * radius * w / 5 * numpy.sin(w / 5 * time)
        radius = radius * (0.6 + 0.4 * numpy.cos(w / 5 * time))
    one, two = numpy.array(path["axes"])
    c, s = numpy.cos(w * time), numpy.sin(w * time)
    position, velocity = radius * c * one, (growing * c - radius * w * s) * one
    if path["shape"] != "line":
        position, velocity = position + radius * s * two, velocity + (growing * s + radius * w * c) * two
    return numpy.array(path["center_m"]) + position, velocity


class HandPath:
    """Joints that keep the hand on a path: differential inverse kinematics with MuJoCo's Jacobians, in small steps."""

    STEP_S = 1 / 400

    def __init__(self, path, hand, duration):
        self.start, self.path, self.hand = numpy.array(path["start_rad"]), path, hand
        _, self.axes = hand.pose(self.start)
        q, self.q = self.start, []
        for step in range(int(duration / self.STEP_S) + 4):
            self.q.append(q)
            h, t = self.STEP_S, step * self.STEP_S
            k1 = self.velocity(q, t)
            k2 = self.velocity(q + h / 2 * k1, t + h / 2)
            k3 = self.velocity(q + h / 2 * k2, t + h / 2)
            q = q + h / 6 * (k1 + 2 * k2 + 2 * k3 + self.velocity(q + h * k3, t + h))

    def velocity(self, q, time):
        position, axes = self.hand.pose(q)
        jacobian, _ = self.hand.jacobians()
        wanted, speed = place(self.path, time)
        motion = numpy.concatenate([speed + 10 * (wanted - position), 10 * turn(axes, self.axes)])
        kept = self.start - q
        return kept + jacobian.T @ numpy.linalg.solve(jacobian @ jacobian.T, motion - jacobian @ kept)

    def at(self, time):
        step = min(int(time / self.STEP_S), len(self.q) - 2)
        q = self.q[step] + (time / self.STEP_S - step) * (self.q[step + 1] - self.q[step])
        if abs(time / self.STEP_S - round(time / self.STEP_S)) > 1e-6:
            # A short step of the integration from the step before.
            since = time - step * self.STEP_S
            k1 = self.velocity(self.q[step], step * self.STEP_S)
            q = self.q[step] + since * self.velocity(self.q[step] + since / 2 * k1, time - since / 2)
        small = 1e-4
        before, now, after = (
            self.velocity(q + small * sign * self.velocity(q, time), time + small * sign) for sign in (-1, 0, 1)
        )
        return q, now, (after - before) / (2 * small)


def planned(from_, to, period):
    """The polynomial between two samples, from the positions, velocities and accelerations at both."""
    powers = numpy.arange(6)
    rows = []
    for s in [0.0, 1.0]:
        for n in range(3):
            factors = numpy.prod([powers - i for i in range(n)], axis=0) if n else numpy.ones(6)
            rows.append(factors * numpy.where(powers >= n, s ** numpy.maximum(powers - n, 0), 0.0))
    scaled = lambda state: [state[n] * period**n for n in range(3)]
    return numpy.linalg.solve(numpy.array(rows), numpy.array(scaled(from_) + scaled(to)))


class Friction:
    def __init__(self, robot):
        self.phi = [numpy.array([robot[f"friction_phi{n}_{joint}"] for joint in range(1, 8)]) for n in (1, 2, 3)]

    def torque(self, velocity):
        one, two, three = self.phi
        return one / (1 + numpy.exp(-two * (velocity + three))) - one / (1 + numpy.exp(-two * three))


def moved(robot, nominal, controller, rate_hz, samples):
    """Positions at each sample and mean torques after it."""
    model, known = panda(robot), panda(nominal, with_damping=False)
    data, knows = mujoco.MjData(model), mujoco.MjData(known)
    friction = Friction(robot)
    gains = json.loads(robot["controller"])
    kp, kd, ki = (numpy.array(gains[name]) for name in ["kp", "kd", "ki"])
    reference = json.loads(robot["reference"])
    law = next(iter(controller["law"]))
    hand = Hand(known, knows, nominal["flange"])
    settled = controller["settle_s"]
    path = HandPath(reference, hand, settled + samples / rate_hz) if "shape" in reference else None
    state_at = path.at if path else lambda time: reference_at(reference, time)
    period = 1 / controller["rate_hz"]
    periods = round(controller["rate_hz"] / rate_hz)
    settling = int(numpy.ceil(controller["settle_s"] * rate_hz))
    ratio = 2 * numpy.pi * controller["velocity_cutoff_hz"] * period
    most = controller["torque_share"] * numpy.array([87, 87, 87, 87, 12, 12, 12])
    model.opt.timestep = period / STEPS
    data.qpos[:] = [robot[f"q0_{joint}"] for joint in range(1, 8)]
    data.qvel[:] = [robot[f"qd0_{joint}"] for joint in range(1, 8)]

    def bias(q, qd):
        knows.qpos[:], knows.qvel[:] = q, qd
        mujoco.mj_fwdPosition(known, knows)
        mujoco.mj_fwdVelocity(known, knows)
        return knows.qfrc_bias.copy()

    q, velocity, total = data.qpos.copy(), data.qvel.copy(), numpy.zeros(7)
    commands = [bias(q, 0 * q)]
    positions, torques = [], []
    for sample in range(settling + samples):
        if sample >= settling:
            positions.append(data.qpos.copy())
        at = [state_at((sample + n) / rate_hz) for n in (0, 1)]
        plan = planned(*at, 1 / rate_hz)
        mean = numpy.zeros(7)
        for number in range(periods):
            measured, share = data.qpos.copy(), number / periods
            velocity += ratio / (1 + ratio) * ((measured - q) / period - velocity)
            q = measured
            course = [
                sum(plan[k] * numpy.prod(range(k - n + 1, k + 1)) * share ** (k - n) for k in range(n, 6)) * rate_hz**n
                for n in range(3)
            ]
            if "kn" in gains:
                command = hand_torques(law, gains, hand, course, q, velocity)
                command = command + bias(q, velocity if law == "operational-space" else 0 * q)
            else:
                total += (course[0] - q) * period
                wish = kp * (course[0] - q) + kd * (course[1] - velocity) + ki * total
            if "kn" in gains:
                pass
            elif law == "joint-pd":
                command = wish + bias(q, 0 * q)
            else:
                command = bias(q, velocity)
                matrix = numpy.zeros((7, 7))
                mujoco.mj_fullM(known, knows, matrix)
                command = command + matrix @ (course[2] + wish)
            command = numpy.clip(command, -most, most)
            change = controller["torque_rate_nm_s"] * period
            command = commands[-1] + numpy.clip(command - commands[-1], -change, change)
            commands.append(command)
            torque = commands[max(len(commands) - 1 - gains["delay_periods"], 0)]
            mean += torque / periods
            for _ in range(STEPS):
                data.qfrc_applied[:] = torque - friction.torque(data.qvel)
                mujoco.mj_step(model, data)
        if sample >= settling:
            torques.append(mean)
    return numpy.array(positions), numpy.array(torques)


def hand_torques(law, gains, hand, course, q, velocity):
    """Torques of a controller of the hand, without C v and gravity."""
    kp, kd = numpy.array(gains["kp"]), numpy.array(gains["kd"])
    r, rd, rdd = course
    goal, goal_axes = hand.pose(r, rd)
    jacobian, change = hand.jacobians()
    goal_speed, goal_acceleration = jacobian @ rd, jacobian @ rdd + change @ rd
    position, axes = hand.pose(q, velocity)
    jacobian, change = hand.jacobians()
    error = numpy.concatenate([goal - position, turn(axes, goal_axes)])
    pull = kp * error + kd * (goal_speed - jacobian @ velocity)
    kept = gains["kn"] * (r - q) + gains["dn"] * (rd - velocity)
    if law == "cartesian-impedance":
        free = kept - jacobian.T @ numpy.linalg.solve(jacobian @ jacobian.T, jacobian @ kept)
        return jacobian.T @ pull + free
    kept = kept + rdd
    matrix = numpy.zeros((7, 7))
    mujoco.mj_fullM(hand.model, hand.data, matrix)
    inertia = numpy.linalg.inv(jacobian @ numpy.linalg.inv(matrix) @ jacobian.T)
    wanted = goal_acceleration + pull - change @ velocity - jacobian @ kept
    return matrix @ kept + jacobian.T @ inertia @ wanted


class ClosedLoop(unittest.TestCase):
    def test_arms_under_a_controller_move_as_in_mujoco(self):
        nothing = {f"{part}_fraction": 0 for part in ["mass", "com", "inertia", "armature", "geometry"]}
        samples = 180
        for law, gains in LAWS.items():
            exact = {"position_noise_rad": 0, "position_resolution_rad": 0, "torque_noise_nm": 0}
            # With these seeds, nine robots have all families, or all shapes.
            seed = 42 if law in HAND_LAWS else 40
            fields = {"samples": samples, "seed": seed, "observations": exact}
            with self.subTest(law=law):
                self.compare(law, gains, fields, nothing, samples)

    def compare(self, law, gains, fields, nothing, samples):
        # A preset's law is replaced whole.
        controller = {
            "law": {law: gains},
            "gain_fraction": 0.3,
            "rate_hz": 1020,
            "delay_periods": [0, 3],
            "velocity_cutoff_hz": 50,
            "torque_share": 1,
            "torque_rate_nm_s": 1000,
            "settle_s": 0.5,
        }
        is_of_hand = law in HAND_LAWS
        excitation = {"excitation": {**dict.fromkeys(["fourier", "point_to_point", "via_points"]), **HAND_PATHS}}
        fields = {**fields, "controller": controller, "trajectories": TRAJECTORIES, **(excitation if is_of_hand else {})}
        rows, robots = simulated(fields)
        _, nominal = simulated({**fields, "trajectories": 1, "robot": {**nothing, "payload": None}})
        columns = lambda name: rows.select([f"{name}{joint}" for joint in range(1, 8)]).to_numpy().astype(float)
        found = [columns(name).reshape(TRAJECTORIES, samples, 7) for name in "qu"]
        families, shapes = set(), set()
        errors = [[], []]
        for index, robot in enumerate(robots.iter_rows(named=True)):
            expected = moved(robot, nominal.row(0, named=True), controller, 60, samples)
            families.add(robot["family"])
            shapes.add(json.loads(robot["reference"]).get("shape"))
            for error, expected, values in zip(errors, expected, found):
                error.append(numpy.abs(values[index] - expected))
        position, torque = (numpy.quantile(error, 0.99) for error in errors)
        print(f"{law}: 99th percentiles {position:.1e} rad, {torque:.1e} N·m, largest {numpy.max(errors[0]):.1e} rad")
        self.assertEqual(len(shapes if is_of_hand else families), 3)
        self.assertLess(position, 1e-4)
        self.assertLess(torque, 0.1)


if __name__ == "__main__":
    unittest.main()

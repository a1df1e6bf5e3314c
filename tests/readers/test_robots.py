"""`torqued robot dynamics` beside Pinocchio, for public arms from their URDFs."""

import json
import os
import re
import subprocess
import sys
import tempfile
import unittest

import numpy
import pinocchio
from product import REPOSITORY, TORQUED

sys.path.insert(0, str(REPOSITORY / "crates/urdf/tests/peers"))
import public_arms  # noqa: E402

STATES = 100
# The largest error of an acceleration, relative to the largest acceleration of the state.
MOST = {"f64": 1e-11, "f32": 5e-5}
# Some mass matrices amplify more: a rounding in the place of an axis or in a torque becomes this many times larger
# in the acceleration of a light wrist.
HARDER = {
    "kinova.urdf": {"f64": 4e-10, "f32": 2e-4},
    "tiago_pro.urdf": {"f64": 4e-11, "f32": 1e-4},
    "z1.urdf": {"f32": 2e-4},
    "xarm7.urdf": {"f32": 5e-4},
    "icub.urdf": {"f32": 2e-4},
}
# The largest error of the torques that Pinocchio says these accelerations take, relative to the largest torque.
MOST_TORQUE = {"f64": 3e-12, "f32": 5e-6}
# The UR10e of recordings that lie beside the repository on some machines.
RECORDED = REPOSITORY.parent / "shared/reference/real/ur10e/ur10e.urdf"
ENVIRONMENT = {key: value for key, value in os.environ.items() if not key.startswith("TORQUED_")}


def robot(command, path, options, states=None):
    """What `torqued robot COMMAND` prints about a URDF: one document per line."""
    words = [TORQUED, "robot", command, str(path), *options]
    ran = subprocess.run(words, input=states, capture_output=True, text=True, env=ENVIRONMENT)
    if ran.returncode != 0:
        raise ValueError(ran.stderr)
    return [json.loads(line) for line in ran.stdout.splitlines()]


class PublicArm:
    """A public arm as a description, and Pinocchio's model of the same URDF."""

    def __init__(self, path, options):
        self.path, self.options = path, options
        try:
            (self.description,) = robot("show", path, [*options, "--json"])
        except ValueError as refusal:
            if "--nearest-physical" not in str(refusal):
                raise
            self.options = [*options, "--nearest-physical"]
            (self.description,) = robot("show", path, [*self.options, "--json"])
            path = public_arms.repaired(path)
        # The URDF that other programs read.
        self.urdf = path
        joints = [joint["name"] for joint in self.description["joints"]]
        sources = self.description["sources"].values()
        (ends,) = (found for source in sources if (found := re.search("from link `(.*?)` to link `(.*?)`", source)))
        base, self.tip = ends.groups()
        arm = {"bodies": [{"joint": name} for name in joints], "base": base}
        self.model, self.base = public_arms.reference(path, arm, public_arms.locks_of(options))
        # Gravity points down in the frame of the base link, which stands upright in the world.
        self.model.gravity.linear = self.base.rotation @ self.model.gravity.linear
        self.order = [self.model.joints[self.model.getJointId(name)].idx_v for name in joints]
        self.damping = numpy.array([joint["damping_nm_s_rad"] for joint in self.description["joints"]])
        limits = [joint["position_rad"] for joint in self.description["joints"]]
        self.low, self.high = numpy.array(limits).T

    def states(self, random):
        """Positions within the limits, speeds of up to 2 rad/s, and torques for accelerations of up to 10 rad/s²."""
        data = self.model.createData()
        for _ in range(STATES):
            q = random.uniform(self.low, self.high)
            qd, qdd = random.uniform(-2.0, 2.0, q.shape), random.uniform(-10.0, 10.0, q.shape)
            full, speeds = self.configured(q, qd)
            accelerations = numpy.zeros(self.model.nv)
            accelerations[self.order] = qdd
            torques = pinocchio.rnea(self.model, data, full, speeds, accelerations)[self.order]
            yield q, qd, torques + self.damping * qd

    def configured(self, q, qd):
        """The state in Pinocchio's order."""
        steps, speeds = numpy.zeros((2, self.model.nv))
        steps[self.order], speeds[self.order] = q, qd
        return pinocchio.integrate(self.model, pinocchio.neutral(self.model), steps), speeds

    def errors(self, state, answer):
        """The relative errors of the accelerations, and of the torques that they take."""
        q, qd, u = state
        data = self.model.createData()
        full, speeds = self.configured(q, qd)
        torques, ours = numpy.zeros((2, self.model.nv))
        torques[self.order] = u - self.damping * qd
        ours[self.order] = answer["qdd"]
        theirs = pinocchio.aba(self.model, data, full, speeds, torques).copy()
        taken = pinocchio.rnea(self.model, data, full, speeds, ours)
        bias = pinocchio.nonLinearEffects(self.model, data, full, speeds)
        scale = max(abs(torques).max(), abs(bias).max())
        return public_arms.relative(ours, theirs), abs(taken - torques).max() / scale

    def answers(self, states, precision):
        lines = [json.dumps(dict(zip(["q", "qd", "u"], map(list, state)))) for state in states]
        options = [*self.options, "--states", "-", "--precision", precision]
        return robot("dynamics", self.path, options, "\n".join(lines))

    def hand(self, q):
        """The place of the tip in the frame of the base."""
        data = self.model.createData()
        pinocchio.framesForwardKinematics(self.model, data, self.configured(q, q)[0])
        tip = data.oMf[self.model.getFrameId(self.tip, pinocchio.FrameType.BODY)]
        return (self.base.inverse() * tip).translation


class Robots(unittest.TestCase):
    def test_accelerations_are_those_of_pinocchio(self):
        robots = public_arms.folder_of_robots()
        arms = [(robots / path, options) for path, options in public_arms.ARMS]
        arms += [(path, []) for path in [RECORDED] if path.exists()]
        random = numpy.random.default_rng(39)
        self.assertGreaterEqual(len(arms), 8)
        exact = 0
        for path, options in arms:
            arm = PublicArm(path, options)
            states = list(arm.states(random))
            printed = []
            is_exact = True
            for precision, most in MOST.items():
                answers = arm.answers(states, precision)
                self.assertEqual(len(answers), STATES)
                found = [arm.errors(state, answer) for state, answer in zip(states, answers)]
                error, of_torque = map(max, zip(*found))
                printed.append(f"{error:.1e} | {of_torque:.1e}")
                is_exact &= error < most
                with self.subTest(path.name, options=options, precision=precision):
                    self.assertLess(error, HARDER.get(path.name, {}).get(precision, most))
                    self.assertLess(of_torque, MOST_TORQUE[precision])
            exact += is_exact
            print("|", " | ".join([path.name, " ".join(options), str(len(arm.order)), *printed]), "|")
            with self.subTest(path.name, options=options, hand=True):
                place = numpy.array(answers[0]["hand"]["position_m"])
                self.assertLess(abs(place - arm.hand(states[0][0])).max(), 1e-11)
        self.assertGreaterEqual(exact, 15)

    def test_a_description_computes_as_the_urdf_does(self):
        path = public_arms.folder_of_robots() / "ur_description/urdf/ur5_robot.urdf"
        options = ["--tip", "tool0", "--mount", "0.1,0,2,180,0,30"]
        (description,) = robot("show", path, [*options, "--json"])
        with tempfile.NamedTemporaryFile("w", suffix=".json") as file:
            json.dump(description, file)
            file.flush()
            self.assertEqual(robot("dynamics", file.name, []), robot("dynamics", path, options))

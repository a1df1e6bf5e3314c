"""`torqued simulate` beside MuJoCo, for public arms from their URDFs.

MuJoCo reads the URDF itself. Both move the nominal arm under gravity, with the same torques, damping, friction and rotor
inertia, from the same states.
"""

import json
import pathlib
import subprocess
import tempfile
import unittest
import xml.etree.ElementTree as ElementTree

import mujoco
import numpy
import pinocchio
import polars
from product import TORQUED
from test_robots import ENVIRONMENT, RECORDED, PublicArm, public_arms

TRAJECTORIES = 4
SECONDS = 1.5
RATE_HZ = 60
FREQUENCY_HZ = 0.5
# Shares of the rated torque: of each of the four components of the torques, and of Coulomb friction.
DRIVE, FRICTION = 0.05, 0.01
ROTOR_KG_M2 = 0.01
# MuJoCo's steps per time constant of the fastest joint, and the fewest per sample.
STEPS_PER_TIME_CONSTANT = 4
FEWEST_STEPS = 40
# The bound of an arm that is thrown further: rated for 84 N m, it weighs 2 kg.
HARDER = {("icub.urdf", "fine"): 5e-6}
# Integrators, whether joints have Coulomb friction, and the bound on the 99th percentile of the errors of positions, rad.
CASES = [
    ("default", {}, False, 1e-4),
    ("fine", {"precision": "f64", "integrator": {"scheme": "extrapolated", "order": 4, "substeps": 64}}, True, 1e-6),
]


def spec_of(description, fields, friction):
    """Torques in proportion to the ratings of the joints. Nothing varies and nothing is rejected."""
    rated = numpy.array([joint["torque_nm"] for joint in description["joints"]])
    # Divisors are 0.01 to 100.
    largest = 0.01 * DRIVE / FREQUENCY_HZ * rated.max()
    return {
        "kind": "simulate",
        "trajectories": TRAJECTORIES,
        "seed": 39,
        "samples": round(SECONDS * RATE_HZ) + 1,
        "rate_hz": RATE_HZ,
        "excitation": {
            "multisine": {
                "frequency_hz": {"fixed": FREQUENCY_HZ},
                "amplitude_nm_per_hz": [-largest, largest],
                "torque_divisor": list(0.01 * rated.max() / rated),
            }
        },
        "robot": {
            "model": description,
            "gravity": "on",
            "friction": {"phi1_fraction": 0} if friction else None,
            **{f"{part}_fraction": 0 for part in ["mass", "com", "inertia", "damping", "armature", "geometry"]},
        },
        "observations": {"joint_velocities": True},
        "rejection": {"position_margin_rad": None},
        **fields,
    }


def simulated(description, fields, friction):
    """Torques and positions [trajectory, sample, joint], and the states at the first samples."""
    joints = range(1, len(description["joints"]) + 1)
    with tempfile.TemporaryDirectory() as folder:
        words = [TORQUED, "simulate", "--spec", "-", "--out", folder]
        text = json.dumps(spec_of(description, fields, friction))
        ran = subprocess.run(words, input=text, capture_output=True, text=True, env=ENVIRONMENT)
        if ran.returncode != 0:
            raise ValueError(ran.stderr)
        read = lambda kind: polars.read_parquet(f"{folder}/{kind}-*.parquet").sort(polars.col("trajectory"))
        rows, robots = read("trajectories").sort("trajectory", "step"), read("robots")
    numbers = lambda table, names: table.select(names).to_numpy().astype(float)
    series = [numbers(rows, [f"{name}{joint}" for joint in joints]) for name in "uq"]
    starts = [numbers(robots, [f"{name}_{joint}" for joint in joints]) for name in ["q0", "qd0"]]
    return *(values.reshape(TRAJECTORIES, -1, len(joints)) for values in series), *starts


def bare(path, moving, locks):
    """The URDF without shapes. All joints but the moving ones are fixed where they stand."""
    root = ElementTree.parse(path).getroot()
    joints = {joint.get("name"): joint for joint in root.iterfind("joint")}
    for kind in ["visual", "collision"]:
        for link in root.iterfind("link"):
            for shape in link.findall(kind):
                link.remove(shape)
    for other in [child for child in root if child.tag not in ["link", "joint"]]:
        root.remove(other)
    parents = {joint.find("child").get("link"): joint for joint in joints.values()}

    def moves(link):
        joint = parents.get(link)
        return joint is not None and (joint.get("name") in moving or moves(joint.find("parent").get("link")))

    for link in root.iterfind("link"):
        if not moves(link.get("name")):
            # Some are impossible, and none matters.
            for inertial in link.findall("inertial"):
                link.remove(inertial)
    for name, joint in joints.items():
        if name in moving:
            joint.set("type", "continuous")
            continue
        position = locks.get(name, 0.0)
        mimic = joint.find("mimic")
        if mimic is not None and name not in locks:
            master = locks.get(mimic.get("joint"), 0.0)
            position = float(mimic.get("multiplier", 1)) * master + float(mimic.get("offset", 0))
        if position != 0.0:
            move(joint, position)
        joint.set("type", "fixed")
    ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler", {"strippath": "true"})
    return ElementTree.tostring(root, encoding="unicode")


def move(joint, position):
    """Puts the joint's position into its origin."""
    vector = lambda text: numpy.array([float(number) for number in text.split()])
    origin = joint.find("origin")
    if origin is None:
        origin = ElementTree.SubElement(joint, "origin")
    turn = pinocchio.rpy.rpyToMatrix(vector(origin.get("rpy", "0 0 0")))
    along = vector(joint.find("axis").get("xyz")) * position
    if joint.get("type") == "prismatic":
        place = vector(origin.get("xyz", "0 0 0")) + turn @ along
        origin.set("xyz", " ".join(map(repr, place.tolist())))
    else:
        turn = turn @ pinocchio.exp3(along)
        origin.set("rpy", " ".join(map(repr, pinocchio.rpy.matrixToRpy(turn).tolist())))


class MovingArm(PublicArm):
    """A public arm with ratings, and MuJoCo's model of the same URDF."""

    def __init__(self, path, options):
        super().__init__(path, options)
        for joint in self.description["joints"]:
            rated = joint["torque_nm"]
            # At least a quarter of the rated torque at the rated speed, as the Panda's nominal damping is.
            joint["damping_nm_s_rad"] = max(joint["damping_nm_s_rad"], 0.25 * rated / joint["velocity_rad_s"])
            joint["armature_kg_m2"] = ROTOR_KG_M2
            joint["friction"] = {"phi1_nm": 2 * FRICTION * rated, "phi2_s_rad": 40.0, "phi3_rad_s": 0.0}
        joints = self.description["joints"]
        names = [joint["name"] for joint in joints]
        self.mujoco = mujoco.MjModel.from_xml_string(bare(self.urdf, names, public_arms.locks_of(options)))
        self.mujoco.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
        self.mujoco.opt.disableflags = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self.mujoco.opt.gravity[:] = self.model.gravity.linear
        self.damping_nm_s_rad = numpy.array([joint["damping_nm_s_rad"] for joint in joints])
        self.places = [self.mujoco.joint(name).dofadr[0] for name in names]
        self.mujoco.dof_damping[self.places] = self.damping_nm_s_rad
        self.mujoco.dof_armature[self.places] = ROTOR_KG_M2
        self.mujoco.dof_frictionloss[:] = 0.0
        self.coulomb = 0.5 * numpy.array([joint["friction"]["phi1_nm"] for joint in joints])

    def steps(self):
        """Runge-Kutta steps per sample."""
        data = mujoco.MjData(self.mujoco)
        mujoco.mj_forward(self.mujoco, data)
        mass = numpy.zeros((self.mujoco.nv, self.mujoco.nv))
        mujoco.mj_fullM(self.mujoco, data, mass)
        # Friction is steepest where a joint turns around.
        resisting = self.damping_nm_s_rad + 20.0 * self.coulomb
        mass = mass[numpy.ix_(self.places, self.places)]
        fastest = abs(numpy.linalg.eigvals(numpy.linalg.solve(mass, numpy.diag(resisting)))).max()
        return max(FEWEST_STEPS, int(numpy.ceil(STEPS_PER_TIME_CONSTANT * fastest / RATE_HZ)))

    def rub(self, _model, data):
        data.qfrc_passive[self.places] -= self.coulomb * numpy.tanh(20.0 * data.qvel[self.places])

    def motion(self, q0, qd0, u, steps, friction):
        """Positions [sample, joint] under torques that are held from sample to sample."""
        self.mujoco.opt.timestep = 1.0 / RATE_HZ / steps
        data = mujoco.MjData(self.mujoco)
        data.qpos[self.places], data.qvel[self.places] = q0, qd0
        positions = [data.qpos[self.places].copy()]
        if friction:
            mujoco.set_mjcb_passive(self.rub)
        for held in u[:-1]:
            data.qfrc_applied[self.places] = held
            mujoco.mj_step(self.mujoco, data, steps)
            positions.append(data.qpos[self.places].copy())
        mujoco.set_mjcb_passive(None)
        return numpy.array(positions)


class Motions(unittest.TestCase):
    def test_trajectories_are_those_of_mujoco(self):
        robots = public_arms.folder_of_robots()
        arms = [(robots / path, options) for path, options in public_arms.ARMS]
        arms += [(path, []) for path in [RECORDED] if path.exists()]
        for path, options in arms:
            arm = MovingArm(path, options)
            steps = arm.steps()
            cells = []
            for name, fields, friction, most in CASES:
                u, q, *starts = simulated(arm.description, fields, friction)
                moved = [arm.motion(q0, qd0, held, steps, friction) for q0, qd0, held in zip(*starts, u)]
                errors = abs(numpy.array(moved) - q)
                found = [*numpy.percentile(errors, [50, 99]), errors.max()]
                cells += [f"{error:.1e}" for error in found]
                with self.subTest(path.name, options=options, integrator=name):
                    self.assertLess(found[1], HARDER.get((path.name, name), most))
            moved = numpy.ptp(q, axis=1).max()
            print("|", " | ".join([path.name, " ".join(options), f"{moved:.1f}", str(steps), *cells]), "|", flush=True)

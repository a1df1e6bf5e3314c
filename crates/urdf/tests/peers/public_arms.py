"""Compares descriptions of public arms with Pinocchio's models of the same URDFs.

    pip install pin==4.1.0 example-robot-data==6.0.0
    cargo build -p urdf --example describe
    python crates/urdf/tests/peers/public_arms.py target/debug/examples/describe [MORE.urdf ..]

Each URDF becomes a description, which is evaluated as a model of its own: one revolute joint about z per row of the
table, one body per link. Pinocchio reads the URDF itself and locks all other joints. Both are asked for gravity, bias
forces, mass matrix and the pose of the tip on 100 random states, with a random mount. Where a description was made with
`--nearest-physical`, Pinocchio gets a URDF whose impossible inertias are repaired here, without the crate.

Prints a table of arms, and fails if an error is above 1e-11, relative to the largest entry.
"""

import json
import pathlib
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree

import numpy
import pinocchio

STATES = 100
MOST = 1e-11

# Folder and file below `robots`, and options.
ARMS = [
    ("panda_description/urdf/panda.urdf", []),
    ("ur_description/urdf/ur3_robot.urdf", []),
    ("ur_description/urdf/ur5_robot.urdf", ["--tip", "tool0"]),
    ("ur_description/urdf/ur5_gripper.urdf", []),
    ("ur_description/urdf/ur10_robot.urdf", ["--tip", "ee_link"]),
    ("kinova_description/robots/kinova.urdf", []),
    ("tiago_description/robots/tiago.urdf", ["--base", "torso_lift_link", "--tip", "arm_tool_link"]),
    ("tiago_description/robots/tiago.urdf", ["--lock", "torso_lift_joint=0.2", "--tip", "arm_7_link"]),
    ("tiago_pro_description/robots/tiago_pro.urdf", ["--lock", "torso_lift_joint=0.1", "--tip", "arm_left_tool_link"]),
    ("talos_data/robots/talos_left_arm.urdf", []),
    ("talos_data/robots/talos_reduced.urdf", ["--base", "torso_2_link", "--tip", "gripper_right_base_link"]),
    ("baxter_description/urdf/baxter.urdf", ["--tip", "left_gripper"]),
    ("pr2_description/urdf/pr2.urdf", ["--base", "torso_lift_link", "--tip", "r_gripper_tool_frame"]),
    ("z1_description/urdf/z1.urdf", []),
    ("so_arm_description/urdf/so100.urdf", []),
    ("so_arm_description/urdf/so101.urdf", ["--lock", "gripper=0.3"]),
    ("xarm_description/urdf/xarm7.urdf", []),
    ("romeo_description/urdf/romeo_small.urdf", ["--base", "torso", "--tip", "r_wrist"]),
    ("romeo_description/urdf/romeo_laas_small.urdf", ["--base", "torso", "--tip", "l_wrist"]),
    ("icub_description/robots/icub.urdf", ["--base", "chest", "--tip", "l_hand"]),
]


def rotation_of_rpy(rpy):
    return pinocchio.rpy.rpyToMatrix(*rpy)


def symmetric(entries):
    xx, xy, xz, yy, yz, zz = entries
    return numpy.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def repaired(path):
    """The URDF with negative second moments of its links raised to almost 0, and points to those of a millimetre."""
    tree = ElementTree.parse(path)
    for inertial in tree.getroot().iterfind("link/inertial"):
        inertia = inertial.find("inertia")
        names = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"]
        matrix = symmetric([float(inertia.get(name)) for name in names])
        moments, axes = numpy.linalg.eigh(0.5 * numpy.trace(matrix) * numpy.eye(3) - matrix)
        if moments.max() > 0.0 and moments.min() >= -1e-12 * abs(moments).max():
            continue
        least = 1e-9 * moments.max() or 1e-6 * float(inertial.find("mass").get("value"))
        moments = numpy.maximum(moments, least)
        matrix = moments.sum() * numpy.eye(3) - axes @ numpy.diag(moments) @ axes.T
        for name, entry in zip(names, matrix[numpy.triu_indices(3)]):
            inertia.set(name, repr(float(entry)))
    with tempfile.NamedTemporaryFile(suffix=".urdf", delete=False) as file:
        tree.write(file)
    return pathlib.Path(file.name)


def step(row, d, yaw_deg):
    """From one frame of the table to the next."""
    alpha = numpy.radians(row.get("alpha_deg", 0.0))
    turn = rotation_of_rpy([alpha, 0.0, 0.0])
    shift = numpy.array(row.get("shift_m", [0.0, 0.0, 0.0])) + [row.get("a_m", 0.0), 0.0, 0.0]
    turned = turn @ rotation_of_rpy([0.0, 0.0, numpy.radians(yaw_deg)])
    return pinocchio.SE3(turned, shift + turn @ [0.0, 0.0, d])


def described(description):
    """A model with the description's table and links, and the placement of the hand."""
    model = pinocchio.Model()
    base = description.get("base", {"position_m": [0.0] * 3, "rpy_deg": [0.0] * 3})
    rotation = rotation_of_rpy(numpy.radians(base["rpy_deg"]))
    placement = pinocchio.SE3(rotation, numpy.array(base["position_m"]))
    joint = 0
    for row in description["joints"]:
        placement = placement * step(row, row["d_m"], row.get("offset_deg", 0.0))
        joint = model.addJoint(joint, pinocchio.JointModelRZ(), placement, row["name"])
        link = row["link"]
        inertia = symmetric(link["inertia_kg_m2"])
        model.appendBodyToJoint(
            joint,
            pinocchio.Inertia(link["mass_kg"], numpy.array(link["center_m"]), inertia),
            pinocchio.SE3.Identity(),
        )
        placement = pinocchio.SE3.Identity()
    hand = description["hand"]
    placement = step(hand, hand["flange_m"], hand["yaw_deg"])
    model.addFrame(pinocchio.Frame("hand", joint, placement, pinocchio.FrameType.OP_FRAME))
    return model


def reference(path, arm, locks):
    """Pinocchio's model of the URDF with all but the arm's joints locked, and the base's pose in it."""
    whole = pinocchio.buildModelFromUrdf(str(path))
    moving = {body["joint"] for body in arm["bodies"]}
    positions = numpy.zeros(whole.nv)
    for name, position in locks.items():
        positions[whole.joints[whole.getJointId(name)].idx_v] = position
    for joint in ElementTree.parse(path).getroot().iterfind("joint"):
        mimic = joint.find("mimic")
        name = joint.get("name")
        if mimic is None or name in locks or not whole.existJointName(name):
            continue
        master = locks.get(mimic.get("joint"), 0.0)
        position = float(mimic.get("multiplier", 1)) * master + float(mimic.get("offset", 0))
        positions[whole.joints[whole.getJointId(name)].idx_v] = position
    posture = pinocchio.integrate(whole, pinocchio.neutral(whole), positions)
    locked = [joint for joint in range(1, whole.njoints) if whole.names[joint] not in moving]
    model = pinocchio.buildReducedModel(whole, locked, posture) if locked else whole
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, pinocchio.neutral(model))
    base = data.oMf[model.getFrameId(arm["base"], pinocchio.FrameType.BODY)].copy()
    return model, base


def locks_of(options):
    """The locked joints and their positions."""
    locks = [lock.split("=") for flag, lock in zip(options, options[1:]) if flag == "--lock"]
    return {joint: float(position) for joint, position in locks}


def call(describe, path, options):
    ran = subprocess.run([describe, str(path), *options], capture_output=True, text=True, check=False)
    if ran.returncode != 0:
        raise ValueError(ran.stderr.strip())
    return json.loads(ran.stdout)


def relative(ours, theirs):
    return float(abs(ours - theirs).max() / max(abs(theirs).max(), 1e-300))


def compared(describe, path, options, random):
    """The arm and its largest relative errors."""
    repairs = False
    try:
        arm = call(describe, path, options)
    except ValueError as refusal:
        if "--nearest-physical" not in str(refusal):
            raise
        repairs = True
        options = [*options, "--nearest-physical"]
        arm = call(describe, path, options)
    locks = locks_of(options)
    theirs, base = reference(repaired(path) if repairs else path, arm, locks)

    # Turned by a random mount, gravity points elsewhere for the same base.
    angles = random.uniform(-180.0, 180.0, 3)
    turn = rotation_of_rpy(numpy.radians(angles))
    mount = [*random.uniform(-1.0, 1.0, 3), *angles]
    arm = call(describe, path, [*options, "--mount", ",".join(repr(float(number)) for number in mount)])
    ours = described(arm["description"])
    theirs.gravity.linear = base.rotation @ turn.T @ ours.gravity.linear
    mounted = pinocchio.SE3(turn, numpy.array(mount[:3]))

    errors = dict.fromkeys(["gravity", "bias", "mass", "tip"], 0.0)
    our_data, their_data = ours.createData(), theirs.createData()
    order = [theirs.joints[theirs.getJointId(name)].idx_v for name in list(ours.names)[1:]]
    for _ in range(STATES):
        q, v = random.uniform(-3.0, 3.0, (2, ours.nv))
        their_steps, their_v = numpy.zeros(theirs.nv), numpy.zeros(theirs.nv)
        their_steps[order], their_v[order] = q, v
        their_q = pinocchio.integrate(theirs, pinocchio.neutral(theirs), their_steps)
        gravity = pinocchio.computeGeneralizedGravity(theirs, their_data, their_q)[order]
        bias = pinocchio.nonLinearEffects(theirs, their_data, their_q, their_v)[order]
        mass = pinocchio.crba(theirs, their_data, their_q, pinocchio.Convention.WORLD)
        mass = (numpy.triu(mass) + numpy.triu(mass, 1).T)[numpy.ix_(order, order)]
        pinocchio.framesForwardKinematics(theirs, their_data, their_q)
        tip = mounted * base.inverse() * their_data.oMf[theirs.getFrameId(arm["tip"], pinocchio.FrameType.BODY)]
        our_mass = pinocchio.crba(ours, our_data, q, pinocchio.Convention.WORLD)
        our_mass = numpy.triu(our_mass) + numpy.triu(our_mass, 1).T
        our_gravity = pinocchio.computeGeneralizedGravity(ours, our_data, q)
        our_bias = pinocchio.nonLinearEffects(ours, our_data, q, v)
        pinocchio.framesForwardKinematics(ours, our_data, q)
        hand = our_data.oMf[ours.getFrameId("hand")]
        for name, error in [
            ("gravity", relative(our_gravity, gravity)),
            ("bias", relative(our_bias, bias)),
            ("mass", relative(our_mass, mass)),
            ("tip", abs(hand.homogeneous - tip.homogeneous).max()),
        ]:
            errors[name] = max(errors[name], error)
    return arm, errors, repairs


def folder_of_robots():
    """The folder of example-robot-data's robots."""
    return next(
        robots
        for folder in map(pathlib.Path, sys.path)
        if (robots := folder / "cmeel.prefix/share/example-robot-data/robots").is_dir()
    )


def main():
    describe, *more = sys.argv[1:]
    robots = folder_of_robots()
    arms = [(robots / path, options) for path, options in ARMS] + [(pathlib.Path(path), []) for path in more]
    random = numpy.random.default_rng(39)
    print("| URDF | options | joints | links | doubts | repaired | gravity | bias | mass | tip, m |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    worst = 0.0
    for path, options in arms:
        try:
            arm, errors, repairs = compared(describe, path, options, random)
        except ValueError as refusal:
            print(f"| {path.name} | {' '.join(options)} | refused: {refusal} |")
            worst = numpy.inf
            continue
        links = sum(len(body["links"]) for body in arm["bodies"])
        cells = [path.name, " ".join(options), len(arm["bodies"]), links, len(arm["doubts"])]
        cells += ["yes" if repairs else "", *(f"{error:.1e}" for error in errors.values())]
        print("|", " | ".join(map(str, cells)), "|")
        worst = max(worst, *errors.values())
    if worst > MOST:
        sys.exit(f"the largest error is {worst:.1e}, allowed: {MOST:.0e}")


if __name__ == "__main__":
    main()

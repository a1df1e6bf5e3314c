"""Compares what is written from descriptions, URDFs and MuJoCo models, with Pinocchio and MuJoCo.

    pip install pin==4.1.0 mujoco==4.0.0 example-robot-data
    cargo build -p urdf --example describe
    python crates/urdf/tests/peers/mujoco_models.py target/debug/examples/describe [MORE.urdf ..]

Each URDF becomes a description. Its bodies, damping, friction and rotor inertias are changed at random, as an
identification changes them, and a payload is put into its hand. The changed description is written into the URDF and as a
MuJoCo model. Pinocchio reads the written URDF and locks all other joints, MuJoCo reads its model, and a third model is made
from the description. They are asked for mass matrix, gravity, bias forces and the pose of the tip on 100 random states.

Prints a table of arms, and fails if an error is above 1e-11, relative to the largest entry.
"""

import json
import pathlib
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree

import mujoco
import numpy
import pinocchio
from public_arms import ARMS, call, described, reference, relative, step, symmetric

STATES = 100
MOST = 1e-11


def text_of(describe, path, options):
    ran = subprocess.run([describe, str(path), *options], capture_output=True, check=False)
    if ran.returncode != 0:
        raise ValueError(ran.stderr.decode().strip())
    return ran.stdout


def body(random):
    moments = random.uniform(1e-4, 5e-2, 3)
    axes = numpy.linalg.qr(random.normal(size=(3, 3)))[0]
    matrix = moments.sum() * numpy.eye(3) - axes @ numpy.diag(moments) @ axes.T
    return {
        "mass_kg": random.uniform(0.1, 5.0),
        "center_m": list(random.uniform(-0.2, 0.2, 3)),
        "inertia_kg_m2": list(matrix[numpy.triu_indices(3)]),
    }


def change(description, random):
    for joint in description["joints"]:
        joint["link"] = body(random)
        joint["damping_nm_s_rad"] = random.uniform(0.0, 5.0)
        joint["armature_kg_m2"] = random.uniform(0.0, 0.5)
        joint["friction"] = {"phi1_nm": random.uniform(0.0, 9.0), "phi2_s_rad": 40.0, "phi3_rad_s": 0.0}
    payload = {"name": "payload", "position_m": list(random.uniform(-0.1, 0.1, 3)), "body": body(random)}
    description["hand"]["bodies"] = [payload]


def with_payload(model, description):
    """The model of a description, with the hand's bodies."""
    hand = description["hand"]
    placement = step(hand, hand["flange_m"], hand["yaw_deg"])
    for part in hand["bodies"]:
        inertia = pinocchio.Inertia(
            part["body"]["mass_kg"],
            numpy.array(part["body"]["center_m"]),
            symmetric(part["body"]["inertia_kg_m2"]),
        )
        shift = pinocchio.SE3(numpy.eye(3), numpy.array(part["position_m"]))
        model.appendBodyToJoint(model.njoints - 1, inertia, placement * shift)
    return model


def check_dynamics(written, description):
    """The written numbers of joints are those of the description."""
    joints = {joint.get("name"): joint for joint in ElementTree.fromstring(written).iterfind("joint")}
    for joint in description["joints"]:
        found = joints[joint["name"]].find("dynamics")
        numbers = [float(found.get("damping")), float(found.get("friction"))]
        assert numbers == [joint["damping_nm_s_rad"], 0.5 * joint["friction"]["phi1_nm"]], joint["name"]


def compared(describe, path, options, random):
    """The largest relative errors of the written URDF and of MuJoCo's model."""
    try:
        arm = call(describe, path, options)
    except ValueError as refusal:
        if "--nearest-physical" not in str(refusal):
            raise
        options = [*options, "--nearest-physical"]
        arm = call(describe, path, options)
    locks = dict(
        (lock.split("=")[0], float(lock.split("=")[1]))
        for flag, lock in zip(options, options[1:])
        if flag == "--lock"
    )
    description = arm["description"]
    change(description, random)
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        (folder / "description.json").write_text(json.dumps(description))
        options = [*options, "--description", str(folder / "description.json")]
        written = text_of(describe, path, [*options, "--as", "urdf"])
        check_dynamics(written, description)
        (folder / "written.urdf").write_bytes(written)
        theirs, base = reference(folder / "written.urdf", arm, locks)
        model = mujoco.MjModel.from_xml_string(text_of(describe, path, [*options, "--as", "mjcf"]).decode())
    ours = with_payload(described(description), description)
    theirs.gravity.linear = base.rotation @ ours.gravity.linear

    joints = list(ours.names)[1:]
    assert [model.joint(index).name for index in range(model.njnt)] == joints
    assert model.nu == model.nv == len(joints)
    for index, joint in enumerate(description["joints"]):
        dof = model.jnt_dofadr[index]
        assert numpy.ravel(model.dof_damping[dof])[0] == joint["damping_nm_s_rad"]
        assert model.dof_frictionloss[dof] == 0.5 * joint["friction"]["phi1_nm"]
        assert model.dof_armature[dof] == joint["armature_kg_m2"]
        assert list(model.jnt_range[index]) == joint["position_rad"]
        assert list(model.jnt_actfrcrange[index]) == [-joint["torque_nm"], joint["torque_nm"]]
        assert list(model.actuator_ctrlrange[index]) == [-joint["torque_nm"], joint["torque_nm"]]
    # Pinocchio's mass matrix is that of the links.
    model.dof_armature[:] = 0.0

    data, our_data, their_data = mujoco.MjData(model), ours.createData(), theirs.createData()
    order = [theirs.joints[theirs.getJointId(name)].idx_v for name in joints]
    parts = ["mass", "gravity", "bias", "tip"]
    errors = {f"{name} {part}": 0.0 for name in ["URDF", "MuJoCo"] for part in parts}
    for _ in range(STATES):
        q, v = random.uniform(-3.0, 3.0, (2, ours.nv))

        def answers(model, data, q, v, order):
            mass = pinocchio.crba(model, data, q, pinocchio.Convention.WORLD)
            mass = (numpy.triu(mass) + numpy.triu(mass, 1).T)[numpy.ix_(order, order)]
            gravity = pinocchio.computeGeneralizedGravity(model, data, q)[order]
            bias = pinocchio.nonLinearEffects(model, data, q, v)[order]
            pinocchio.framesForwardKinematics(model, data, q)
            return [mass, gravity.copy(), bias.copy()]

        expected = answers(ours, our_data, q, v, list(range(ours.nv)))
        tip = our_data.oMf[ours.getFrameId("hand")].homogeneous

        their_steps, their_v = numpy.zeros(theirs.nv), numpy.zeros(theirs.nv)
        their_steps[order], their_v[order] = q, v
        their_q = pinocchio.integrate(theirs, pinocchio.neutral(theirs), their_steps)
        found = answers(theirs, their_data, their_q, their_v, order)
        their_tip = their_data.oMf[theirs.getFrameId(arm["tip"], pinocchio.FrameType.BODY)]
        found.append((base.inverse() * their_tip).homogeneous)

        data.qpos[:], data.qvel[:] = q, 0.0
        mujoco.mj_forward(model, data)
        gravity = data.qfrc_bias.copy()
        data.qvel[:] = v
        mujoco.mj_forward(model, data)
        mass = numpy.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, mass)
        site = numpy.eye(4)
        site[:3, :3] = data.site(arm["tip"]).xmat.reshape(3, 3)
        site[:3, 3] = data.site(arm["tip"]).xpos
        made = [mass, gravity, data.qfrc_bias, site]

        for name, values in [("URDF", found), ("MuJoCo", made)]:
            for part, value, exact in zip(parts, values, [*expected, tip]):
                key = f"{name} {part}"
                errors[key] = max(errors[key], relative(value, exact))
    return arm, errors


def main():
    describe, *more = sys.argv[1:]
    robots = next(
        robots
        for folder in map(pathlib.Path, sys.path)
        if (robots := folder / "cmeel.prefix/share/example-robot-data/robots").is_dir()
    )
    arms = [(robots / path, options) for path, options in ARMS] + [(pathlib.Path(path), []) for path in more]
    random = numpy.random.default_rng(39)
    worst = 0.0
    for number, (path, options) in enumerate(arms):
        arm, errors = compared(describe, path, options, random)
        if number == 0:
            print("| URDF | options | joints |", " | ".join(errors), "|")
            print("|---" * (3 + len(errors)) + "|")
        cells = [path.name, " ".join(options), len(arm["bodies"]), *(f"{error:.1e}" for error in errors.values())]
        print("|", " | ".join(map(str, cells)), "|", flush=True)
        worst = max(worst, *errors.values())
    if worst > MOST:
        sys.exit(f"the largest error is {worst:.1e}, allowed: {MOST:.0e}")


if __name__ == "__main__":
    main()

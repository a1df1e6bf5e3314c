"""A robot of a dataset as a MuJoCo model."""

import mujoco
import numpy as np

from datasets import HAND_YAW, TWISTS

NAME = f"MuJoCo {mujoco.__version__}"


def numbers(*values):
    return " ".join(f"{value:.17g}" for value in values)


def xml(robot, integrator, timestep):
    """The arm in MuJoCo's format: no contacts, limits or actuators."""
    opened = closed = ""
    for joint, (link, origin) in enumerate(zip(robot.links, robot.origins())):
        half = TWISTS[joint] / 2
        inertia = link.inertia
        diagonal = [inertia[axis, axis] for axis in range(3)]
        off_diagonal = [inertia[0, 1], inertia[0, 2], inertia[1, 2]]
        opened += f"""
          <body pos="{numbers(*origin)}" quat="{numbers(np.cos(half), np.sin(half), 0, 0)}">
          <inertial pos="{numbers(*link.com)}" mass="{numbers(link.mass)}"
                    fullinertia="{numbers(*diagonal, *off_diagonal)}"/>
          <joint type="hinge" axis="0 0 1" damping="{numbers(robot.damping[joint])}"
                 armature="{numbers(robot.armature[joint])}"/>"""
        closed += "</body>"
    yaw = numbers(np.cos(HAND_YAW / 2), 0, 0, np.sin(HAND_YAW / 2))
    hand = f'<site name="hand" pos="{numbers(0, 0, robot.flange)}" quat="{yaw}"/>'
    return f"""<mujoco>
      <compiler angle="radian"/>
      <option timestep="{numbers(timestep)}" integrator="{integrator}"
              gravity="{numbers(0, 0, -robot.gravity)}">
        <flag contact="disable" constraint="disable"/>
      </option>
      <worldbody>{opened}{hand}{closed}</worldbody>
    </mujoco>"""


def model(robot, integrator, timestep):
    return mujoco.MjModel.from_xml_string(xml(robot, integrator, timestep))


class Arm:
    """The robot at its initial state, advanced sample by sample with classical Runge-Kutta steps."""

    def __init__(self, robot, substeps):
        self.robot, self.substeps = robot, substeps
        self.model = model(robot, "RK4", 1 / robot.rate_hz / substeps)
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:], self.data.qvel[:] = robot.q0, robot.qd0
        # Statics use a copy, so that the integration does not change.
        self.at_rest = mujoco.MjData(self.model)

    @property
    def q(self):
        return self.data.qpos.copy()

    @property
    def qd(self):
        return self.data.qvel.copy()

    def advance(self, torque):
        """Advances by one sample with the torque held."""
        self.data.qfrc_applied[:] = torque
        if self.robot.friction is not None:
            mujoco.set_mjcb_passive(self.rub)
        mujoco.mj_step(self.model, self.data, self.substeps)
        mujoco.set_mjcb_passive(None)

    def rub(self, _model, data):
        data.qfrc_passive[:] -= self.robot.friction_torque(data.qvel)

    def gravity(self, q):
        """The torque that holds the robot still at `q`, N m."""
        self.at_rest.qpos[:] = q
        mujoco.mj_forward(self.model, self.at_rest)
        return self.at_rest.qfrc_bias.copy()

    def pose(self, q):
        """Position of the hand, and its quaternion x, y, z, w."""
        self.at_rest.qpos[:] = q
        mujoco.mj_kinematics(self.model, self.at_rest)
        hand = self.at_rest.site("hand")
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, hand.xmat)
        return hand.xpos.copy(), np.roll(quaternion, -1)

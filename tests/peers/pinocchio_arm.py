"""A robot of a dataset as a Pinocchio model."""

import numpy as np
import pinocchio as pin

from datasets import HAND_YAW, TWISTS

NAME = f"Pinocchio {pin.__version__}"


def model(robot):
    arm = pin.Model()
    joint = 0
    for link, origin, twist in zip(robot.links, robot.origins(), TWISTS):
        placement = pin.SE3(pin.rpy.rpyToMatrix(twist, 0, 0), origin)
        joint = arm.addJoint(joint, pin.JointModelRZ(), placement, f"joint{joint + 1}")
        body = pin.Inertia(link.mass, link.com, link.inertia)
        arm.appendBodyToJoint(joint, body, pin.SE3.Identity())
    arm.armature = robot.armature
    arm.gravity.linear = np.array([0, 0, -robot.gravity])
    hand = pin.SE3(pin.rpy.rpyToMatrix(0, 0, HAND_YAW), np.array([0, 0, robot.flange]))
    arm.addFrame(pin.Frame("hand", joint, 0, hand, pin.FrameType.OP_FRAME))
    return arm


class Arm:
    """The robot at its initial state, advanced sample by sample with classical Runge-Kutta steps."""

    def __init__(self, robot, substeps):
        self.robot, self.substeps = robot, substeps
        self.model = model(robot)
        self.data = self.model.createData()
        self.hand = self.model.getFrameId("hand")
        self.q, self.qd = robot.q0.copy(), robot.qd0.copy()

    def acceleration(self, q, qd, torque):
        torque = torque - self.robot.damping * qd
        if self.robot.friction is not None:
            torque -= self.robot.friction_torque(qd)
        return pin.aba(self.model, self.data, q, qd, torque).copy()

    def advance(self, torque):
        """Advances by one sample with the torque held."""
        h = 1 / self.robot.rate_hz / self.substeps
        q, v1 = self.q, self.qd
        for _ in range(self.substeps):
            a1 = self.acceleration(q, v1, torque)
            v2 = v1 + h / 2 * a1
            a2 = self.acceleration(q + h / 2 * v1, v2, torque)
            v3 = v1 + h / 2 * a2
            a3 = self.acceleration(q + h / 2 * v2, v3, torque)
            v4 = v1 + h * a3
            a4 = self.acceleration(q + h * v3, v4, torque)
            q = q + h / 6 * (v1 + 2 * v2 + 2 * v3 + v4)
            v1 = v1 + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        self.q, self.qd = q, v1

    def gravity(self, q):
        """The torque that holds the robot still at `q`, N m."""
        return pin.computeGeneralizedGravity(self.model, self.data, q).copy()

    def pose(self, q):
        """Position of the hand, and its quaternion x, y, z, w."""
        pin.framesForwardKinematics(self.model, self.data, q)
        pose = self.data.oMf[self.hand]
        return pose.translation.copy(), pin.Quaternion(pose.rotation).coeffs().copy()

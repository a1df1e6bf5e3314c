"""Rebuilds robots of a dataset in MuJoCo and Pinocchio and simulates them again.

    python tests/peers/rebuild.py FOLDER [FOLDER ...] [--robots 50]

`cargo xtask peers` makes datasets from tests/peers/specs and runs this on all of them. A FOLDER is the output of
`torqued simulate --out FOLDER`. The simulators get only the contents of the table of robots: bodies, lengths,
friction, initial state, and the coefficients of the excitation, which is evaluated again. Both integrate with
Runge-Kutta steps far finer than needed. Errors are those of whole trajectories: the largest of any joint at any
sample. The exit status is 1 if one is larger than allowed.

Specs with friction use Runge-Kutta steps, but other ones than here. Where a joint turns around, the bend of its
sigmoid causes errors of up to 7e-4 rad in the default integrator.
"""

import argparse
import sys

import numpy as np

import datasets
import mujoco_arm
import pinocchio_arm

# Bounds on the 99th percentile of the trajectories' errors. Velocities have a larger one because of
# the second sample: by then light wrists have lost their initial velocity, at rates that the
# dataset's integrator damps and does not resolve.
ALLOWED = {"q": 1e-4, "qd": 1e-2, "position": 1e-4, "orientation": 2e-4, "u": 1e-4}
UNIT = {"q": "rad", "qd": "rad/s", "position": "m", "orientation": "rad", "u": "N m"}


def drive(arm, robot, samples):
    """Torques, positions and velocities of the arm under its excitation, [samples, 7] each."""
    excitation = robot.excitation(samples)
    u, q, qd = (np.empty((samples, 7)) for _ in range(3))
    for k in range(samples):
        q[k], qd[k] = arm.q, arm.qd
        held = excitation[k]
        if robot.gravity_compensated:
            held = held + arm.gravity(q[k])
        # The dataset's torques are those that acted, in single precision.
        u[k] = held.astype(np.float32)
        arm.advance(u[k])
    return u, q, qd


def errors(simulator, robot, recorded, substeps):
    """The largest errors of one trajectory by name, and the simulated positions."""
    samples = len(recorded.q)
    arm = simulator.Arm(robot, substeps)
    u, q, qd = drive(arm, robot, samples)
    largest = {"q": np.abs(q - recorded.q).max()}
    # Compensation follows the positions. Here these are the dataset's, to test only the torques.
    expected = robot.excitation(samples)
    if robot.gravity_compensated:
        expected = expected + np.array([arm.gravity(sample) for sample in recorded.q])
    largest["u"] = np.abs(expected - recorded.u).max()
    if recorded.qd is not None:
        largest["qd"] = np.abs(qd - recorded.qd).max()
    if recorded.pose is not None:
        largest["position"], largest["orientation"] = pose_errors(arm, q, recorded.pose)
    return largest, q


def pose_errors(arm, q, recorded):
    """Errors in m and rad. A recorded pose whose quaternion jumps is refused, too."""
    position = orientation = 0.0
    for k, sample in enumerate(q):
        translation, quaternion = arm.pose(sample)
        position = max(position, np.abs(translation - recorded[k, :3]).max())
        # The angle follows from the difference of the quaternions, because the angle between them
        # would be lost in rounding.
        sign = np.sign(quaternion @ recorded[k, 3:])
        orientation = max(orientation, 2 * np.linalg.norm(sign * quaternion - recorded[k, 3:]))
    jumps = (recorded[1:, 3:] * recorded[:-1, 3:]).sum(axis=1) < 0
    if jumps.any() or recorded[0, 6] < 0:
        raise ValueError("the recorded quaternion jumps, or begins with qw < 0")
    return position, orientation


def percentile(values, fraction):
    return np.quantile(values, fraction, method="higher")


def judge(folder, count, substeps):
    """Prints the errors, and tells whether all are allowed."""
    pairs = datasets.read(folder, count)
    families = [robot.family for robot, _ in pairs]
    drawn = ", ".join(f"{families.count(family)} {family}s" for family in sorted(set(families)))
    print(f"{folder}: {len(pairs)} robots rebuilt ({drawn})", flush=True)
    good, positions = True, {}
    for simulator in (mujoco_arm, pinocchio_arm):
        results = [errors(simulator, robot, recorded, substeps) for robot, recorded in pairs]
        positions[simulator.NAME] = np.array([q for _, q in results])
        for name in results[0][0]:
            values = np.array([largest[name] for largest, _ in results])
            p50, p99 = percentile(values, 0.5), percentile(values, 0.99)
            # A comparison with NaN must fail, too.
            fine = bool(p99 <= ALLOWED[name])
            good &= fine
            print(
                f"  {simulator.NAME:16} {name:12} p50 {p50:.1e}  p99 {p99:.1e}  max {values.max():.1e}"
                f"  {UNIT[name]:6} {'ok' if fine else f'MORE THAN {ALLOWED[name]}'}",
                flush=True,
            )
    between = np.abs(np.subtract(*positions.values())).max()
    print(f"  {'one from the other':16} {'q':12} max {between:.1e}  rad", flush=True)
    return good


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folders", nargs="+", metavar="FOLDER")
    parser.add_argument("--robots", type=int, default=50, help="to rebuild of each dataset")
    parser.add_argument("--substeps", type=int, default=12, help="Runge-Kutta steps per sample")
    arguments = parser.parse_args()
    good = [judge(folder, arguments.robots, arguments.substeps) for folder in arguments.folders]
    print(f"{sum(good)} of {len(good)} datasets rebuilt")
    return 0 if all(good) else 1


if __name__ == "__main__":
    sys.exit(main())

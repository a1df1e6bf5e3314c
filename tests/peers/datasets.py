"""Reads a dataset's folder: the robots in their table, and their recordings."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars

# Twists of the modified Denavit-Hartenberg table, rad. The table of robots has its lengths.
TWISTS = np.pi / 2 * np.array([0, -1, 1, 1, -1, 1, 1])
# Angle about the flange's axis, from the frame of link 7 to the hand's, rad.
HAND_YAW = -np.pi / 4


@dataclass
class Link:
    mass: float
    """kg"""
    com: np.ndarray
    """[3] in the link's frame, m"""
    inertia: np.ndarray
    """[3, 3] about the centre of mass in the axes of the link's frame, kg m^2"""


class Robot:
    """One row of the table of robots, in SI units. Arrays have an entry per joint."""

    def __init__(self, row):
        def joints(name):
            return np.array([row[f"{name}_{joint}"] for joint in range(1, 8)], dtype=float)

        self.trajectory = row["trajectory"]
        self.family = row["family"]
        self.rate_hz = row["rate_hz"]
        self.gravity = row["gravity_m_s2"]
        self.gravity_compensated = row["gravity_compensated"]
        self.q0, self.qd0 = joints("q0"), joints("qd0")
        self.a, self.d, self.flange = joints("a"), joints("d"), row["flange"]
        self.damping, self.armature = joints("damping"), joints("armature")
        self.links = [link(row, number) for number in range(1, 8)]
        self.friction = None
        if row["friction_phi1_1"] is not None:
            self.friction = [joints(f"friction_phi{number}") for number in (1, 2, 3)]
        if self.family == "chirp":
            names = ["offset_nm", "amplitude_nm", "f1_hz", "f2_hz", "depth", "phase_rad"]
            self.chirp = [joints(f"chirp_{name}") for name in names]
        else:
            self.multisine = [
                (joints(f"multisine_amplitude{part}_nm"), joints(f"multisine_f{part}_hz"))
                for part in range(4)
            ]

    def origins(self):
        """The origin of each joint's frame in the frame before it, [7, 3], m."""
        return np.stack([self.a, -self.d * np.sin(TWISTS), self.d * np.cos(TWISTS)], axis=1)

    def excitation(self, samples):
        """Torques without compensation, [samples, 7], N m."""
        t = np.arange(samples)[:, None] / self.rate_hz
        if self.family == "chirp":
            offset, amplitude, f1, f2, depth, phase = self.chirp
            modulation = 1 + depth * np.cos(2 * np.pi * f2 * t)
            return offset + amplitude * np.cos(2 * np.pi * f1 * modulation * t + phase)
        waves = [np.sin, np.cos, np.sin, np.cos]
        return sum(
            amplitude * wave(2 * np.pi * frequency * t)
            for wave, (amplitude, frequency) in zip(waves, self.multisine)
        )

    def friction_torque(self, qd):
        """Torques against the motion besides damping, N m."""
        phi1, phi2, phi3 = self.friction
        return phi1 / (1 + np.exp(-phi2 * (qd + phi3))) - phi1 / (1 + np.exp(-phi2 * phi3))


def link(row, number):
    xx, xy, xz, yy, yz, zz = (
        row[f"{entry}_{number}"] for entry in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    return Link(
        mass=row[f"mass_{number}"],
        com=np.array([row[f"com_{axis}_{number}"] for axis in "xyz"]),
        inertia=np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]),
    )


@dataclass
class Recording:
    """Recorded series, [samples, channel] each, with `qd` and `pose` if the dataset has them."""

    u: np.ndarray
    q: np.ndarray
    qd: np.ndarray | None
    pose: np.ndarray | None
    """x, y, z in m, then a unit quaternion x, y, z, w"""


def read(folder, count):
    """Pairs of robot and recording: `count` of them, spread evenly over the dataset."""
    table = polars.concat(polars.read_parquet(file) for file in files(folder, "robots"))
    chosen = np.unique(np.linspace(0, len(table) - 1, min(count, len(table))).round().astype(int))
    robots = [Robot(row) for row in table[chosen].iter_rows(named=True)]
    indices = [robot.trajectory for robot in robots]
    steps = polars.concat(
        polars.scan_parquet(file).filter(polars.col("trajectory").is_in(indices)).collect()
        for file in files(folder, "trajectories")
    ).sort("trajectory", "step")
    by_trajectory = steps.partition_by("trajectory", maintain_order=True)
    return [(robot, recording(rows)) for robot, rows in zip(robots, by_trajectory, strict=True)]


def files(folder, content):
    found = sorted(Path(folder).glob(f"{content}-*.parquet"))
    if not found:
        raise FileNotFoundError(f"no {content}-*.parquet in {folder}")
    return found


def recording(rows):
    def channels(names):
        if names[0] not in rows.columns:
            return None
        return rows.select(names).to_numpy().astype(float)

    numbered = lambda prefix: [f"{prefix}{joint}" for joint in range(1, 8)]
    return Recording(
        u=channels(numbered("u")),
        q=channels(numbered("q")),
        qd=channels(numbered("qd")),
        pose=channels([f"ee_{part}" for part in ("x", "y", "z", "qx", "qy", "qz", "qw")]),
    )

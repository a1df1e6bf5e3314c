"""Makes joint_states.mcap and joint_states.npz: the same 60 samples of a UR arm at 60 Hz.

    pip install mcap-ros2-support==0.6.0 numpy && python tests/data/joint_states.py

The joints come in alphabetical order, as `joint_state_broadcaster` publishes them.
"""

import math
import pathlib

import numpy as np
from mcap_ros2.writer import Writer

FOLDER = pathlib.Path(__file__).parent
JOINTS = ["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint"]
DEFINITION = """\
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
"""

rows = range(60)
t = np.array([k / 60 for k in rows])
q = np.array([[0.5 * math.sin(2 * k / 60 + joint) for joint in range(6)] for k in rows])
qd = np.array([[math.cos(2 * k / 60 + joint) for joint in range(6)] for k in rows])
u = np.array([[3 * math.cos(k / 60 - joint) for joint in range(6)] for k in rows])
np.savez_compressed(FOLDER / "joint_states.npz", t=t, q=q, qd=qd, u=np.asfortranarray(u))

order = sorted(range(6), key=lambda joint: JOINTS[joint])
with open(FOLDER / "joint_states.mcap", "wb") as file:
    writer = Writer(file, chunk_size=4096)
    schema = writer.register_msgdef("sensor_msgs/msg/JointState", DEFINITION)
    for k in rows:
        nanoseconds = 1_700_000_000_000_000_000 + round(1e9 * t[k])
        sec, nanosec = divmod(nanoseconds, 1_000_000_000)
        message = {
            "header": {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": "base_link"},
            "name": [JOINTS[joint] for joint in order],
            "position": [q[k][joint] for joint in order],
            "velocity": [qd[k][joint] for joint in order],
            "effort": [u[k][joint] for joint in order],
        }
        writer.write_message("/joint_states", schema, message, nanoseconds, nanoseconds, k)
    writer.finish()

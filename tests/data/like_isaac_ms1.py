"""Writes like_isaac_ms1.parquet: made-up recordings in the format of another simulator.

The columns, their types and the file's compression are those of RoboMorph's `MS1` curves (Isaac Gym, 60 Hz, torque
driven, u includes gravity compensation), written by pyarrow: one row per sample, consecutive rows of an arm, f32,
nullable, dictionaries, zstd. The motions differ: a damped double integrator per joint. Run it with pyarrow 21 or
later. It has no other dependencies.

    python tests/data/like_isaac_ms1.py tests/data/like_isaac_ms1.parquet
"""

import math
import sys

import pyarrow as pa
import pyarrow.parquet as pq

ARMS, SAMPLES, RATE_HZ, DAMPING, INERTIA = 2, 450, 60.0, 10.0, 0.8
MIDDLE = [0.0, 0.0, 0.0, -1.5708, 0.0, 1.8675, 0.0]
GRAVITY_NM = [0.0, -25.0, 0.0, 20.0, 0.0, 2.0, 0.0]


def joint(arm, number):
    """Torques and positions of a joint."""
    frequency = 0.15 * (1 + 0.3 * arm) * 2 * math.pi
    q, qd, us, qs = MIDDLE[number], 0.0, [], []
    for k in range(SAMPLES):
        u = 4.0 * math.sin(frequency * k / RATE_HZ + number) / (1 + number % 3)
        us.append(u + GRAVITY_NM[number] * math.cos(q - MIDDLE[number]))
        qs.append(q)
        qd = (qd + u / INERTIA / RATE_HZ) / (1 + DAMPING / INERTIA / RATE_HZ)
        q += qd / RATE_HZ
    return us, qs


def main(path):
    columns = {"trajectory": [], "step": [], "t": []}
    columns |= {f"{name}{number + 1}": [] for name in "uq" for number in range(7)}
    for arm in range(ARMS):
        columns["trajectory"] += [arm] * SAMPLES
        columns["step"] += range(SAMPLES)
        columns["t"] += [k / RATE_HZ for k in range(SAMPLES)]
        for number in range(7):
            us, qs = joint(arm, number)
            columns[f"u{number + 1}"] += us
            columns[f"q{number + 1}"] += qs
    ids = ("trajectory", "step")
    table = pa.table(
        {name: pa.array(values, pa.int32() if name in ids else pa.float32()) for name, values in columns.items()}
    )
    table = table.replace_schema_metadata({"units": "u N*m, q rad, t s", "source": "tests/data/like_isaac_ms1.py"})
    pq.write_table(table, path, compression="zstd")


if __name__ == "__main__":
    main(sys.argv[1])

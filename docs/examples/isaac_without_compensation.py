"""Takes out of u what held the arms of isaac_ms1.parquet, and says what is left to explain.

    python isaac_without_compensation.py isaac_ms1.parquet isaac_without_compensation.parquet

For each arm and joint u is fitted by least squares on velocity, acceleration, 1 and all seven positions; what 1 and the
positions carry is taken for gravity compensation. The whole recording is used: this stands in for a log of the
compensation, and is no way to forecast.
"""

import sys

import numpy as np
import polars as pl

JOINTS = range(1, 8)
RATE_HZ = 60.0

rows = pl.read_parquet(sys.argv[1]).sort("trajectory", "step")
arms = rows["trajectory"].n_unique()
u, q = (rows.select(f"{name}{k}" for k in JOINTS).to_numpy().astype(float).reshape(arms, -1, 7) for name in "uq")
velocity = RATE_HZ * np.diff(q, axis=1)
held = np.empty_like(u)
damping, left = np.empty((arms, 7)), np.empty((arms, 7))
for arm in range(arms):
    for joint in range(7):
        after, before = velocity[arm, 1:, joint], velocity[arm, :-1, joint]
        terms = np.column_stack([after, RATE_HZ * (after - before), np.ones(len(after)), q[arm, 1:-1]])
        fitted, *_ = np.linalg.lstsq(terms, u[arm, 1:-1, joint], rcond=None)
        damping[arm, joint] = fitted[0]
        left[arm, joint] = np.std(u[arm, 1:-1, joint] - terms @ fitted)
        held[arm, :, joint] = fitted[2] + q[arm] @ fitted[3:]

rows.with_columns(
    pl.Series(f"u{k}", (u - held)[:, :, k - 1].ravel().astype(np.float32)) for k in JOINTS
).write_parquet(sys.argv[2])
for what, values in [
    ("u, mean, N·m", u.mean((0, 1))),
    ("u without compensation, deviation, N·m", (u - held).std((0, 1))),
    ("damping, mean over arms, N·m·s/rad", damping.mean(0)),
    ("damping, deviation over arms", damping.std(0)),
    ("left over, N·m", left.mean(0)),
    ("largest speed, rad/s", np.abs(velocity).max((0, 1))),
]:
    print(f"{what:40}", *(f"{value:9.4f}" for value in values))

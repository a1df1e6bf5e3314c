"""Writes train.csv and test.csv for docs/guides/recordings.md: simulated recordings of an arm, in the units of a typical log.

    pip install polars
    python docs/examples/recordings.py

One Panda moves 60 times for 20 s, each time with another payload of 0 to 2 kg. Its controller compensates its own gravity, its joints have friction,
and its encoders have a noise of 0.0001 rad. The log has 100 rows per second: time in ms, angles in degrees, torques in N·m, gravity compensation
included. The last 12 recordings go into test.csv.
"""

import json
import pathlib
import subprocess
import tempfile

import polars

RATE_HZ, RECORDINGS, OF_THEM_TEST = 100, 60, 12
SPEC = {
    "kind": "simulate",
    "trajectories": RECORDINGS,
    "samples": 20 * RATE_HZ,
    "rate_hz": RATE_HZ,
    "seed": 7,
    "excitation": {"multisine": {"frequency_hz": {"uniform": [0.1, 0.2]}}},
    "robot": {
        "payload": {"mass_kg": [0, 2]},
        "friction": {},
        "mass_fraction": 0,
        "com_fraction": 0,
        "inertia_fraction": 0,
        "damping_fraction": 0,
    },
    "observations": {"position_noise_rad": 1e-4},
}


def main():
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        (folder / "spec.json").write_text(json.dumps(SPEC))
        subprocess.run(["torqued", "simulate", "--spec", folder / "spec.json", "--out", folder / "arm"], check=True)
        rows = polars.read_parquet(folder / "arm/trajectories-00000.parquet")
    joints = range(1, 8)
    log = rows.select(
        polars.col("trajectory").alias("run"),
        (polars.col("step") * (1000 / RATE_HZ)).alias("stamp"),
        *(polars.col(f"u{j}").round(4).alias(f"tau_{j}") for j in joints),
        *(polars.col(f"q_measured{j}").degrees().round(5).alias(f"pos_{j}") for j in joints),
    )
    is_test = polars.col("run") >= RECORDINGS - OF_THEM_TEST
    log.filter(~is_test).write_csv("train.csv")
    log.filter(is_test).write_csv("test.csv")


if __name__ == "__main__":
    main()

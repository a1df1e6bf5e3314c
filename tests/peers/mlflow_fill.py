"""Fills the database of a stopped MLflow server: a run with a long metric, and many short runs.

    python mlflow_fill.py DATABASE POINTS RUNS

Prints the id of the run with the long metric `loss`. The rows are like those of this version's server, which would
need hours to write them one request at a time.
"""

import math
import sqlite3
import sys
import uuid

BEGAN_MS = 1_700_000_000_000
METRICS = ("loss", "rmse", "rmse_deg", "seconds", "samples")
PARAMS = ("model", "optimizer", "learning_rate", "batch", "seed")


def add_run(database, name, at):
    run = uuid.uuid4().hex
    artifacts = f"mlflow-artifacts:/0/{run}/artifacts"
    database.execute(
        "INSERT INTO runs VALUES (?, ?, 'UNKNOWN', '', '', 'bench', 'FINISHED', ?, ?, '', 'active', ?, 0, NULL)",
        (run, name, at, at + 1000, artifacts),
    )
    database.execute("INSERT INTO tags VALUES ('mlflow.runName', ?, ?)", (name, run))
    return run


def main(path, points, runs):
    database = sqlite3.connect(path)
    for number in range(runs):
        at = BEGAN_MS + number
        run = add_run(database, f"run-{number}", at)
        for key in METRICS:
            row = (key, number / 7, at, run)
            database.execute("INSERT INTO metrics VALUES (?, ?, ?, ?, 1, 0)", row)
            database.execute("INSERT INTO latest_metrics VALUES (?, ?, ?, 1, 0, ?)", row)
        for key in PARAMS:
            database.execute("INSERT INTO params VALUES (?, ?, ?)", (key, str(number % 9), run))
    long = add_run(database, "long", BEGAN_MS + runs)
    rows = (("loss", math.sin(step / 1000), BEGAN_MS + step, long, step) for step in range(points))
    database.executemany("INSERT INTO metrics VALUES (?, ?, ?, ?, ?, 0)", rows)
    last = (math.sin((points - 1) / 1000), BEGAN_MS + points - 1, points - 1, long)
    database.execute("INSERT INTO latest_metrics VALUES ('loss', ?, ?, ?, 0, ?)", last)
    database.commit()
    print(long)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))

"""A model that torqued does not know: ridge regression from torques to positions.

    pip install numpy polars
    torqued serve                                        # and in another terminal:
    torqued submit two-models --watch
    python docs/examples/ridge.py http://127.0.0.1:7070 my-ridge.parquet 20
"""

import json
import sys
import urllib.request

import numpy
import polars

CONTEXT = 320  # samples that a predictor is given, as in the evaluation
LAGS = 8  # samples at the end of the context that the model looks at
PENALTY = 1e4
U = [f"u{joint}" for joint in range(1, 8)]
Q = [f"q{joint}" for joint in range(1, 8)]


def read(server, name):
    """The rows of a dataset, in order."""
    with urllib.request.urlopen(f"{server}/v1/datasets") as answer:
        dataset = next(d for d in json.load(answer)["datasets"] if d["name"] == name)
    with urllib.request.urlopen(f"{server}/v1/datasets/{dataset['id']}") as answer:
        files = [file for file in json.load(answer)["files"] if file["content"] == "trajectories"]
    rows = polars.concat(polars.read_parquet(server + file["url"]) for file in files)
    return rows.select("trajectory", "step", *U, *Q).sort("trajectory", "step")


def channels(rows, names):
    """[trajectory, step, joint]"""
    return rows.select(names).to_numpy().reshape(rows["trajectory"].n_unique(), -1, len(names)).astype("f8")


def features(rows):
    """Motion and torques at the end of the context, and the torques of the horizon. No position of the horizon."""
    u, q = channels(rows, U), channels(rows, Q)
    last = q[:, CONTEXT - LAGS : CONTEXT]
    known = [numpy.diff(last, axis=1), last, u[:, CONTEXT - LAGS :]]
    x = numpy.concatenate([part.reshape(len(q), -1) for part in known], axis=1)
    return numpy.concatenate([x, numpy.ones((len(x), 1))], axis=1), q[:, CONTEXT - 1 : CONTEXT]


def fit(rows):
    """The weights, and what they leave unexplained of each trajectory."""
    x, last = features(rows)
    y = (channels(rows, Q)[:, CONTEXT:] - last).reshape(len(x), -1)
    weights = numpy.linalg.solve(x.T @ x + PENALTY * numpy.eye(x.shape[1]), x.T @ y)
    return weights, y - x @ weights


def predict(weights, rows):
    """Positions of the horizon, [trajectory, step, joint], rad."""
    x, last = features(rows)
    return (x @ weights).reshape(len(x), -1, len(Q)) + last


def main(server, path, samples=0):
    weights, residuals = fit(read(server, "train-set"))
    scenarios = read(server, "test-grid")
    predicted = predict(weights, scenarios)

    # The horizon's rows of the dataset, with predicted positions in place of the measured ones.
    horizon = scenarios.filter(polars.col("step") >= CONTEXT)
    answer = horizon.with_columns(polars.Series(name, predicted[..., k].ravel()) for k, name in enumerate(Q))
    # A column with the trajectory names each recording: "7".
    parts = [answer.with_columns(polars.col("trajectory").cast(str))]
    # Samples are named by trajectory and sample: "7/0", "7/1", ..
    draw = numpy.random.default_rng(0)
    for k in range(samples):
        errors = residuals[draw.integers(len(residuals), size=len(predicted))].reshape(predicted.shape)
        sample = predicted + errors
        columns = [polars.Series(name, sample[..., j].ravel()) for j, name in enumerate(Q)]
        recording = polars.format("{}/{}", "trajectory", polars.lit(k)).alias("trajectory")
        parts.append(horizon.with_columns(*columns, recording))
    polars.concat(parts).write_parquet(path)


if __name__ == "__main__":
    main(sys.argv[1].rstrip("/"), sys.argv[2], int(sys.argv[3]) if len(sys.argv) > 3 else 0)

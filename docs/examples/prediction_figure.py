"""The figure of README.md: one arm of the quickstart's test set, and what two checkpoints predict of it.

    pip install matplotlib polars
    torqued quickstart                                              # and in another terminal:
    python docs/examples/prediction_figure.py http://127.0.0.1:7070 docs/figures/prediction.svg
"""

import json
import sys
import urllib.request

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt
import polars

CONTEXT, RATE_HZ, DEGREES = 320, 60.0, 57.29577951308232
TRAJECTORY = 82  # via-points at 1.25 Hz; the models were trained at 0.5 to 1 Hz
NOISE_RAD = 2e-5  # of the measured positions
COLOURS = {"lagrangian": "#0b6e4f", "robomorph": "#c8553d"}


def ask(url, body=None):
    request = urllib.request.Request(url, None if body is None else json.dumps(body).encode())
    request.add_header("Content-Type", "application/json")
    with urllib.request.urlopen(request) as answer:
        return json.load(answer)


def test_set(server):
    return next(d for d in ask(f"{server}/v1/datasets")["datasets"] if d["name"] == "test-grid")


def arm(server, trajectory):
    """Measured torques and positions of one arm, and its true positions, [time, 7] each."""
    shard = f"{server}/v1/datasets/{test_set(server)['id']}/files/trajectories-00000.parquet"
    steps = polars.scan_parquet(shard).filter(polars.col("trajectory") == trajectory).sort("step").collect()
    return [steps.select(f"^{name}[0-9]$").rows() for name in ("u_measured", "q_measured", "q")]


def final_checkpoints(server):
    found = ask(f"{server}/v1/checkpoints")["checkpoints"]
    return {c["architecture"]: c["id"] for c in found if c["final"] and c["architecture"] in COLOURS}


def main(server, out):
    u, measured, q = arm(server, TRAJECTORY)
    scenario = {"u": u[:CONTEXT], "y": measured[:CONTEXT], "future_u": u[CONTEXT:]}
    joint = max(range(7), key=lambda j: max(row[j] for row in q) - min(row[j] for row in q))
    time = [step / RATE_HZ for step in range(len(q))]
    truth = [row[joint] * DEGREES for row in q]

    plt.rcParams.update({"font.size": 9, "svg.hashsalt": "torqued", "axes.spines.top": False, "axes.spines.right": False})
    figure, (motion, error) = plt.subplots(1, 2, figsize=(9, 2.8), width_ratios=[2, 1], layout="constrained")
    motion.axvspan(0, CONTEXT / RATE_HZ, color="#eef1f4", lw=0)
    motion.plot(time, truth, color="black", lw=1.2, label="the arm")
    for name, checkpoint in sorted(final_checkpoints(server).items()):
        answer = ask(f"{server}/v1/checkpoints/{checkpoint}/predict", {"scenarios": [scenario], "position_noise_rad": NOISE_RAD})
        predicted = [row[joint] * DEGREES for row in answer["scenarios"][0]["y"]]
        motion.plot(time[CONTEXT:], predicted, "--", color=COLOURS[name], lw=1.6, label=name)
        off = [p - t for p, t in zip(predicted, truth[CONTEXT:])]
        error.plot(time[CONTEXT:], off, color=COLOURS[name], lw=1.4, label=name)
    top = motion.get_ylim()[1]
    motion.text(0.05, top, "context: seen by the model", va="bottom", color="#667788")
    motion.text(CONTEXT / RATE_HZ + 0.05, top, "horizon", va="bottom", color="#667788")
    motion.set(xlabel="time, s", ylabel=f"angle of joint {joint + 1}, °", xlim=(0, time[-1]))
    motion.legend(loc="lower right", frameon=False)
    error.axhline(0, color="#99aabb", lw=0.6)
    error.set(xlabel="time, s", ylabel="error, °")
    figure.savefig(out, metadata={"Date": None, "Creator": None})


if __name__ == "__main__":
    main(*sys.argv[1:])

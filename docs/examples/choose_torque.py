"""Chooses a torque with a model: predicts many candidates at once, and takes the one that ends nearest to the goal.

    python docs/examples/choose_torque.py 8     # the checkpoint

A new simulated arm stands in for yours. The question is which constant torque moves joint 4 by 0.2 rad within the horizon.
"""

import sys
import time

import torqued

JOINT, TURN_RAD = 4, 0.2
CONTEXT, HORIZON, JOINTS = 320, 80, range(1, 8)
CANDIDATES_NM = [0.25 * k for k in range(-16, 17)]
ARM = {"preset": "D1-multisine", "trajectories": 1, "samples": 1000, "seed": 20}


def main(checkpoint):
    client = torqued.Client()
    job = client.wait(client.submit(ARM))
    columns = client.trajectory(job["dataset"], 0)["columns"]
    u = list(zip(*(columns[f"u{j}"][:CONTEXT] for j in JOINTS)))
    q = list(zip(*(columns[f"q{j}"][:CONTEXT] for j in JOINTS)))
    goal = q[-1][JOINT - 1] + TURN_RAD

    scenarios = []
    for torque in CANDIDATES_NM:
        planned = [torque if joint == JOINT else 0.0 for joint in JOINTS]
        scenarios.append({"u": u, "y": q, "future_u": [planned] * HORIZON})
    began = time.monotonic()
    answer = client.predict(checkpoint, scenarios)
    ends = [scenario["y"][-1][JOINT - 1] for scenario in answer["scenarios"]]
    best = min(range(len(ends)), key=lambda k: abs(ends[k] - goal))
    print(f"{CANDIDATES_NM[best]:+.2f} N·m moves joint {JOINT} to {ends[best]:.3f} rad; the goal is {goal:.3f} rad")
    took, computed = 1000 * (time.monotonic() - began), answer["latency_ms"]["compute"]
    print(f"{len(ends)} candidates took {took:.0f} ms, of which the model computed {computed:.0f} ms")


if __name__ == "__main__":
    main(int(sys.argv[1]))

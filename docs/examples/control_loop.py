"""A controller's loop around a model: at every sample it sends what was measured and planned, and gets where the arm will be.

    python docs/examples/control_loop.py 8                  # the checkpoint; speaks to `torqued stream`, needs nothing but Python
    python docs/examples/control_loop.py 8 --websocket      # the same over a WebSocket: pip install websockets

A new simulated arm stands in for yours: its torques and angles come at 60 Hz. The loop changes no torque: it says when a joint will leave its
soft limit, and how long before that.
"""

import argparse
import contextlib
import json
import statistics
import subprocess
import time

import torqued

SOFT_LIMIT_RAD = 0.5  # how far a joint may be from where it was when the loop began
ARM = {"preset": "D1-multisine", "trajectories": 1, "samples": 1000, "seed": 20}


@contextlib.contextmanager
def by_command(client, checkpoint):
    """Asks through a child process: a line of JSON in, a line of JSON out."""
    command = [torqued.find_binary(), "stream", str(checkpoint), "--server", client.server]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1) as child:

        def exchange(line):
            child.stdin.write(line + "\n")
            return child.stdout.readline()

        yield exchange


@contextlib.contextmanager
def by_websocket(client, checkpoint):
    from websockets.sync.client import connect

    with connect(f"{client.server.replace('http', 'ws', 1)}/v1/checkpoints/{checkpoint}/stream") as stream:

        def exchange(line):
            stream.send(line)
            return stream.recv()

        yield exchange


def ask(exchange, message):
    answer = json.loads(exchange(json.dumps(message)))
    if "error" in answer:
        raise RuntimeError(answer["error"]["detail"])
    return answer


def measured_arm(client):
    """Torques and angles of an arm, [time][joint]."""
    job = client.wait(client.submit(ARM))
    columns = client.trajectory(job["dataset"], 0)["columns"]
    joints = range(1, 8)
    return list(zip(*(columns[f"u{j}"] for j in joints))), list(zip(*(columns[f"q{j}"] for j in joints)))


def outside(angles, start):
    """The joint that is farthest outside its soft limit, counted from 1; 0 if none is."""
    distances = [abs(angle - begin) for angle, begin in zip(angles, start)]
    return distances.index(max(distances)) + 1 if max(distances) > SOFT_LIMIT_RAD else 0


def run(exchange, u, q):
    opened = ask(exchange, {"open": {}})["opened"]
    context, horizon, period = opened["context"], opened["horizon"], 1 / opened["rate_hz"]
    ask(exchange, {"step": {"u": u[:context], "y": q[:context]}})
    start = q[context]

    latencies_ms, predictions = [], {}
    foreseen = happened = None
    due = time.monotonic()
    for now in range(context, len(q) - horizon):
        time.sleep(max(0.0, due - time.monotonic()))  # the next sample of the arm
        due += period
        began = time.monotonic()
        step = {"u": [u[now]], "y": [q[now]], "future_u": u[now + 1 : now + 1 + horizon]}
        path = ask(exchange, {"step": step})["prediction"]["y"]
        latencies_ms.append(1000 * (time.monotonic() - began))
        predictions[now] = path

        # A controller that guards a limit would plan other torques here.
        seconds = (now - context) * period
        leaves = next((k for k, angles in enumerate(path) if outside(angles, start)), None)
        if foreseen is None and leaves is not None:
            foreseen = now
            print(f"{seconds:5.2f} s  joint {outside(path[leaves], start)} will leave its soft limit in {(leaves + 1) * period:.2f} s")
        if happened is None and outside(q[now], start):
            happened = now
            print(f"{seconds:5.2f} s  joint {outside(q[now], start)} has left it")

    for ahead in (6, 30, 78):
        errors = [
            abs(angle - truth)
            for now, path in predictions.items()
            for angle, truth in zip(path[ahead - 1], q[now + ahead])
        ]
        print(f"mean error {ahead * period:.1f} s ahead: {57.29578 * statistics.fmean(errors):.3f}°")
    late = sum(latency > 1000 * period for latency in latencies_ms)
    median, p99 = statistics.median(latencies_ms), statistics.quantiles(latencies_ms, n=100)[98]
    print(f"{len(latencies_ms)} predictions, {median:.1f} ms (median), {p99:.1f} ms (p99), {late} later than a sample")


def main():
    arguments = argparse.ArgumentParser()
    arguments.add_argument("checkpoint", type=int)
    arguments.add_argument("--websocket", action="store_true")
    arguments = arguments.parse_args()
    client = torqued.Client()
    u, q = measured_arm(client)
    connection = by_websocket if arguments.websocket else by_command
    with connection(client, arguments.checkpoint) as exchange:
        run(exchange, u, q)


if __name__ == "__main__":
    main()

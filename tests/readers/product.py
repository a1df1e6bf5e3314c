"""Torqued servers for these tests: an empty one, one with two models that trained shortly, and one with a quickstart."""

import json
import os
import pathlib
import socket
import subprocess
import tempfile
import time
import urllib.request

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]
TORQUED = os.environ.get("TORQUED", str(REPOSITORY / "target/release/torqued"))

# Seconds of training with the ids of the whole pipeline, which depend on the number of checkpoints.
SPEC = {
    "preset": "two-models",
    "jobs": {
        "train-set": {"trajectories": 2048, "shard_trajectories": 1024},
        "train": {"steps": 30, "optimizer": {"warmup_steps": 0}, "checkpoint_every_steps": 5},
    },
}


def usual_port_is_free():
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", 7070))
        except OSError:
            return False
    return True


class Server:
    """A server on an empty data folder until `stop`. `url` is its address."""

    def __init__(self, *options):
        self.folder = tempfile.TemporaryDirectory(prefix="torqued-readers-")
        self.start(*options)

    def start(self, *options):
        listen = "127.0.0.1:7070" if usual_port_is_free() else "127.0.0.1:0"
        self.process = subprocess.Popen(
            [TORQUED, "serve", "--data", f"{self.folder.name}/data", "--listen", listen, *options],
            stdout=subprocess.PIPE,
            text=True,
        )
        self.url = self.process.stdout.readline().split()[-1]

    def get(self, path):
        with urllib.request.urlopen(self.url + path) as answer:
            return json.load(answer)

    def post(self, path, body):
        request = urllib.request.Request(
            self.url + path,
            data=json.dumps(body).encode(),
            headers={"content-type": "application/json"},
        )
        with urllib.request.urlopen(request) as answer:
            return json.load(answer)

    def wait(self, job):
        for _ in range(3000):
            state = self.get(f"/v1/jobs/{job}")
            if state["state"] in ("succeeded", "failed", "cancelled"):
                assert state["state"] == "succeeded", state
                return
            time.sleep(0.1)
        raise TimeoutError(f"job {job} does not end")

    def download(self, url, folder):
        path = pathlib.Path(folder) / url.rsplit("/", 1)[-1]
        urllib.request.urlretrieve(self.url + url, path)
        return path

    def restart(self, *options):
        """Serves the same data folder with other options."""
        self.end()
        self.start(*options)

    def end(self):
        self.process.terminate()
        self.process.wait(timeout=60)
        self.process.stdout.close()

    def stop(self):
        self.end()
        self.folder.cleanup()


class Product(Server):
    """A server on which the `pipeline` of two models has succeeded."""

    def __init__(self):
        super().__init__()
        self.pipeline = self.post("/v1/jobs", SPEC)["id"]
        self.wait(self.pipeline)

    def member(self, name):
        members = self.get(f"/v1/jobs/{self.pipeline}")["members"]
        job = next(member["job"] for member in members if member["name"] == name)
        return self.get(f"/v1/jobs/{job}")


class Quickstart(Server):
    """A server whose data folder `torqued quickstart` has filled; `printed` is what it printed."""

    def __init__(self):
        super().__init__()
        self.end()
        self.printed = self.quickstart()
        self.start()

    def quickstart(self):
        """Runs the command on the data folder, which no server has open, and returns what it prints."""
        command = ["quickstart", "--exit", "--data", f"{self.folder.name}/data", "--listen", "127.0.0.1:0"]
        done = subprocess.run([TORQUED, *command], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

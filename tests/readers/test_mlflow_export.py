"""`torqued export --mlflow` to an unmodified MLflow server, read back with MLflow's client."""

import json
import os
import pathlib
import signal
import socket
import subprocess
import tempfile
import threading
import time
import unittest
import urllib.error
import urllib.request
import warnings
from http.server import BaseHTTPRequestHandler, HTTPServer

os.environ.update(
    NO_PROXY="127.0.0.1",
    MLFLOW_DISABLE_TELEMETRY="true",
    MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR="false",
    GIT_PYTHON_REFRESH="quiet",
    MLFLOW_HTTP_REQUEST_MAX_RETRIES="0",
)

from mlflow import MlflowClient  # noqa: E402

from product import REPOSITORY, TORQUED, Product  # noqa: E402

# The server's packages conflict with those of the other tests: `cargo xtask test` makes this environment.
MLFLOW_PYTHON = os.environ.get("MLFLOW_PYTHON", str(REPOSITORY / "target/peers/mlflow/bin/python"))


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class MlflowServer:
    """MLflow's own server on SQLite, in a folder of its own."""

    def __init__(self, *options):
        self.folder = tempfile.TemporaryDirectory(prefix="torqued-mlflow-server-")
        port = free_port()
        self.url = f"http://127.0.0.1:{port}"
        database = f"sqlite:///{self.folder.name}/mlflow.db"
        self.process = subprocess.Popen(
            [MLFLOW_PYTHON, "-m", "mlflow", "server", "--host", "127.0.0.1", "--port", str(port),
             "--workers", "1", "--backend-store-uri", database, *options],
            cwd=self.folder.name,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            # It starts processes of its own, which end with the group.
            start_new_session=True,
        )
        for _ in range(600):
            try:
                urllib.request.urlopen(f"{self.url}/health").close()
                return
            except OSError:
                time.sleep(0.2)
        self.stop()
        raise TimeoutError("MLflow's server does not answer")

    def stop(self):
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        self.folder.cleanup()


class Refusing(BaseHTTPRequestHandler):
    """Asks for a login, like a proxy in front of an MLflow server."""

    def do_GET(self):
        self.send_response(401)
        self.end_headers()
        self.wfile.write(b"You are not authenticated.")

    def log_message(self, *_):
        pass


def points_of(client, run, key):
    points = client.get_metric_history(run, key)
    return sorted((point.step, point.timestamp, point.value) for point in points)


class Export(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        warnings.simplefilter("ignore", ResourceWarning)
        cls.product = Product()
        cls.addClassCleanup(cls.product.stop)
        cls.mlflow = MlflowServer()
        cls.addClassCleanup(cls.mlflow.stop)
        cls.folder = tempfile.TemporaryDirectory(prefix="torqued-mlflow-export-")
        cls.addClassCleanup(cls.folder.cleanup)
        cls.ours = MlflowClient(cls.product.url)
        cls.theirs = MlflowClient(cls.mlflow.url)

    def run_export(self, *arguments, to=None):
        command = [TORQUED, "export", "--mlflow", to or self.mlflow.url, *arguments]
        return subprocess.run(
            [*command, "--server", self.product.url], capture_output=True, text=True
        )

    def export(self, *arguments, to=None):
        done = self.run_export(*arguments, "--json", to=to)
        self.assertEqual(done.returncode, 0, done.stderr)
        return [json.loads(line) for line in done.stdout.splitlines()]

    def refused(self, *arguments, to=None):
        done = self.run_export(*arguments, to=to)
        lines = [line for line in done.stderr.splitlines() if not line.startswith("export")]
        self.assertEqual(len(lines), 1, done.stderr)
        return done.returncode, lines[0]

    def assert_equals_ours(self, exported):
        ours = self.ours.get_run(f"torqued-{exported['run']}")
        theirs = self.theirs.get_run(exported["mlflow_run"])
        for name in ["run_name", "status", "start_time", "end_time"]:
            self.assertEqual(getattr(theirs.info, name), getattr(ours.info, name), name)
        self.assertEqual(theirs.data.params, ours.data.params)
        self.assertEqual(set(theirs.data.metrics), set(ours.data.metrics))
        for key in ours.data.metrics:
            expected = points_of(self.ours, ours.info.run_id, key)
            self.assertEqual(points_of(self.theirs, theirs.info.run_id, key), expected, key)
        for key, value in ours.data.tags.items():
            if key not in ("torqued.page", "mlflow.note.content"):
                self.assertEqual(theirs.data.tags[key], value, key)
        page = self.product.url + ours.data.tags["torqued.page"]
        self.assertEqual(theirs.data.tags["torqued.page"], page)
        self.assertIn(f"]({self.product.url}/jobs/", theirs.data.tags["mlflow.note.content"])
        return ours, theirs

    def assert_has_all_files(self, ours, theirs):
        sent = self.theirs.download_artifacts(theirs.info.run_id, "", tempfile.mkdtemp(dir=self.folder.name))
        kept = self.ours.download_artifacts(ours.info.run_id, "", tempfile.mkdtemp(dir=self.folder.name))
        files = {}
        for root in (sent, kept):
            paths = (path for path in pathlib.Path(root).rglob("*") if path.is_file())
            files[root] = {str(path.relative_to(root)): path.read_bytes() for path in paths}
        manifest = json.loads(files[sent].pop("torqued.json"))
        self.assertEqual(files[sent], files[kept])
        self.assertEqual(set(manifest["files"]), set(files[kept]))
        return manifest

    def test_all_runs_are_there_with_every_point_and_every_file(self):
        exported = self.export("--all", "--experiment", "everything")
        self.assertEqual(len(exported), len(self.product.get("/v1/runs")["runs"]))
        for run in exported:
            self.assertTrue(run["created"])
            manifest = self.assert_has_all_files(*self.assert_equals_ours(run))
            self.assertEqual(manifest["run"], self.product.get(f"/v1/runs/{run['run']}"))

    def test_a_run_that_is_exported_twice_is_there_once(self):
        run = str(self.product.member("train")["run"])
        (first,) = self.export("--run", run, "--experiment", "twice")
        (second,) = self.export("--run", run, "--experiment", "twice")
        self.assertEqual((first["created"], second["created"]), (True, False))
        self.assertGreater(first["points"], 30)
        self.assertGreater(first["files"], 4)
        self.assertEqual((second["points"], second["files"]), (0, 0))
        self.assertEqual(first["mlflow_run"], second["mlflow_run"])
        self.assert_equals_ours(second)
        experiment = self.theirs.get_experiment_by_name("twice")
        self.assertEqual(len(self.theirs.search_runs([experiment.experiment_id])), 1)

    def test_labels_that_change_and_files_that_were_lost_are_brought_up_to_date(self):
        run = self.product.member("train")["run"]
        label = [TORQUED, "label", "run", str(run), "--server", self.product.url]
        subprocess.run([*label, "--tag", "keep", "--note", "good"], check=True, capture_output=True)
        (first,) = self.export("--run", str(run), "--experiment", "labels")
        tags = self.theirs.get_run(first["mlflow_run"]).data.tags
        self.assertEqual((tags["torqued.tags"], tags["mlflow.note.content"]), ("keep", "good"))
        self.assertEqual(tags["keep"], "")
        subprocess.run(
            [*label, "--remove-tag", "keep", "--note", "", "--name", "best"],
            check=True, capture_output=True,
        )
        (folder, *_) = self.theirs.list_artifacts(first["mlflow_run"], "checkpoints")
        lost = f"{folder.path}/model.safetensors"
        artifacts = f"{self.mlflow.url}/api/2.0/mlflow-artifacts/artifacts"
        uri = self.theirs.get_run(first["mlflow_run"]).info.artifact_uri
        place = uri.removeprefix("mlflow-artifacts:/")
        request = urllib.request.Request(f"{artifacts}/{place}/{lost}", method="DELETE")
        urllib.request.urlopen(request).close()
        (second,) = self.export("--run", str(run), "--experiment", "labels")
        self.assertEqual((second["created"], second["files"]), (False, 1))
        theirs = self.theirs.get_run(first["mlflow_run"])
        self.assertNotIn("torqued.tags", theirs.data.tags)
        self.assertNotIn("keep", theirs.data.tags)
        self.assertEqual(theirs.info.run_name, "best")
        self.assert_has_all_files(*self.assert_equals_ours(second))
        subprocess.run([*label, "--name", ""], check=True, capture_output=True)

    def test_a_filter_chooses_and_without_files_there_are_none(self):
        chosen = "tags.torqued.kind = 'train'"
        exported = self.export("--filter", chosen, "--experiment", "chosen", "--without-files")
        trainings = self.product.get("/v1/runs?kind=train")["runs"]
        self.assertEqual([run["run"] for run in exported], sorted(run["id"] for run in trainings))
        self.assertEqual(self.theirs.list_artifacts(exported[0]["mlflow_run"]), [])
        code, line = self.refused("--filter", "tags.x ~ 1", "--experiment", "chosen")
        self.assertEqual(code, 1)
        self.assertIn("~", line)

    def test_a_run_that_was_deleted_in_mlflow_stays_deleted(self):
        run = str(self.product.member("train")["run"])
        (first,) = self.export("--run", run, "--experiment", "deleted", "--without-files")
        self.theirs.delete_run(first["mlflow_run"])
        done = self.run_export("--run", run, "--experiment", "deleted", "--without-files")
        self.assertIn(f"run {run} is deleted in MLflow", done.stderr)
        self.assertIn("0 runs", done.stdout)
        self.theirs.delete_experiment(self.theirs.get_experiment_by_name("deleted").experiment_id)
        code, line = self.refused("--run", run, "--experiment", "deleted")
        self.assertIn("is deleted in the MLflow server", line)

    def test_a_server_that_is_not_there_or_asks_for_a_login_is_said_in_a_sentence(self):
        code, line = self.refused("--all", to=f"http://127.0.0.1:{free_port()}")
        self.assertEqual(code, 4)
        self.assertIn("no answer from the MLflow server http://127.0.0.1", line)
        proxy = HTTPServer(("127.0.0.1", 0), Refusing)
        threading.Thread(target=proxy.serve_forever, daemon=True).start()
        self.addCleanup(proxy.server_close)
        self.addCleanup(proxy.shutdown)
        code, line = self.refused("--all", to=f"http://127.0.0.1:{proxy.server_port}")
        self.assertEqual(code, 1)
        self.assertIn("refused the login (401 Unauthorized); set MLFLOW_TRACKING_USERNAME", line)
        code, line = self.refused("--all", to=f"{self.product.url}/nothing")
        self.assertIn("is this MLflow's address?", line)

    def test_a_limit_of_mlflow_is_said_in_its_words(self):
        code, line = self.refused("--all", "--experiment", "x" * 501)
        self.assertEqual(code, 1)
        self.assertIn("refused experiments/create: ", line)
        self.assertIn("500", line)

    def test_a_server_that_leaves_files_to_its_clients_is_told_apart(self):
        direct = MlflowServer("--no-serve-artifacts")
        self.addCleanup(direct.stop)
        run = str(self.product.member("train")["run"])
        code, line = self.refused("--run", run, to=direct.url)
        self.assertEqual(code, 1)
        self.assertIn("give --without-files", line)
        (exported,) = self.export("--run", run, "--without-files", to=direct.url)
        client = MlflowClient(direct.url)
        self.assertEqual(len(client.get_metric_history(exported["mlflow_run"], "train/loss")), 30)


if __name__ == "__main__":
    unittest.main()

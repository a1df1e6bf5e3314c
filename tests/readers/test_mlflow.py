"""The unmodified client of MLflow: the snippets of docs/mlflow.md, and other calls."""

import json
import math
import os
import pathlib
import re
import subprocess
import tempfile
import unittest
import warnings

os.environ.update(
    NO_PROXY="127.0.0.1",
    MLFLOW_DISABLE_TELEMETRY="true",
    MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR="false",
    GIT_PYTHON_REFRESH="quiet",
    # The client does not retry: an error answer fails the test at once.
    MLFLOW_HTTP_REQUEST_MAX_RETRIES="0",
)

import mlflow  # noqa: E402
from mlflow import MlflowClient  # noqa: E402
from mlflow.entities import Metric, Param, RunTag, ViewType  # noqa: E402
from mlflow.exceptions import MlflowException  # noqa: E402

from product import REPOSITORY, TORQUED, Product  # noqa: E402

DOCUMENT = (REPOSITORY / "docs/mlflow.md").read_text()


class Mlflow(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        warnings.simplefilter("ignore", ResourceWarning)
        cls.product = Product()
        cls.addClassCleanup(cls.product.stop)
        cls.folder = tempfile.TemporaryDirectory(prefix="torqued-mlflow-")
        cls.addClassCleanup(cls.folder.cleanup)
        cls.client = MlflowClient(cls.product.url)

    def snippet(self, holds):
        snippets = re.findall(r"```python\n(.*?)```", DOCUMENT, flags=re.DOTALL)
        (snippet,) = [snippet for snippet in snippets if holds in snippet]
        snippet = snippet.replace("http://127.0.0.1:7070", self.product.url)
        done = subprocess.run(
            [str(REPOSITORY / ".venv/bin/python"), "-c", snippet],
            cwd=self.folder.name,
            capture_output=True,
            text=True,
        )
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout.splitlines()

    def refused(self, code, call, *arguments, **named):
        with self.assertRaises(MlflowException) as caught:
            call(*arguments, **named)
        self.assertEqual(caught.exception.error_code, code, caught.exception)
        return str(caught.exception)

    def own_runs(self, filter_string=""):
        experiment = self.client.get_experiment_by_name("torqued")
        return self.client.search_runs([experiment.experiment_id], filter_string)

    def test_the_snippet_that_reads_works(self):
        lines = self.snippet("get_metric_history")
        self.assertIn("torqued-", lines[0])
        weights = pathlib.Path(self.folder.name, lines[-1])
        self.assertGreater(weights.stat().st_size, 1000)

    def test_the_snippet_that_logs_works(self):
        lines = self.snippet("log_params")
        self.assertEqual(lines[-2:], ["least squares 0.09", "joint 3 sticks"])

    def test_a_training_has_the_params_metrics_and_files_that_torqued_says(self):
        job = self.product.member("train")
        (run,) = self.own_runs(f"tags.torqued.job = '{job['id']}'")
        said = self.product.get(f"/v1/runs/{job['run']}")
        self.assertEqual(run.info.status, "FINISHED")
        self.assertEqual(run.data.params["steps"], "30")
        self.assertEqual(run.data.tags["torqued.digest"], job["digest"])
        latest = {key: metric["value"] for key, metric in said["metrics"].items()}
        self.assertEqual(run.data.metrics, latest)
        history = self.client.get_metric_history(run.info.run_id, "train/loss")
        self.assertEqual(len(history), 30)
        folders = self.client.list_artifacts(run.info.run_id, "checkpoints")
        files = self.client.list_artifacts(run.info.run_id, folders[-1].path)
        self.assertIn(f"{folders[-1].path}/model.safetensors", [file.path for file in files])

    def test_a_report_is_downloaded_whole(self):
        (run,) = self.own_runs("tags.torqued.kind = 'evaluate'")
        path = self.client.download_artifacts(run.info.run_id, "report.json", self.folder.name)
        said = self.product.get(f"/v1{run.data.tags['torqued.page']}/artifacts/report.json")
        self.assertEqual(json.loads(pathlib.Path(path).read_text()), said)
        everything = self.client.download_artifacts(run.info.run_id, "", self.folder.name)
        files = self.client.list_artifacts(run.info.run_id)
        self.assertEqual(
            sorted(os.listdir(everything)),
            sorted({file.path for file in files} | set(os.listdir(self.folder.name))),
        )

    def test_nothing_but_labels_can_be_logged_to_torqueds_own_runs(self):
        run = self.own_runs()[0].info.run_id
        message = self.refused("PERMISSION_DENIED", self.client.log_metric, run, "loss", 1.0)
        self.assertIn("torqued's own", message)
        self.refused("PERMISSION_DENIED", self.client.set_tag, run, "torqued.job", "7")
        self.refused("PERMISSION_DENIED", self.client.delete_run, run)

    def test_labels_go_both_ways(self):
        client = self.client
        job = self.product.member("train")
        run = f"torqued-{job['run']}"
        status = client.get_run(run).info.status
        client.update_run(run, name="three seeds")
        client.set_tag(run, "mlflow.note.content", "sticks at joint 3")
        client.set_tag(run, "stage", "lab")
        client.set_tag(run, "baseline", "")
        client.set_terminated(run, "FAILED")
        mlflow.set_tracking_uri(self.product.url)
        with mlflow.start_run(run_id=run):
            mlflow.set_tags({"stage": "field", "bench": "3"})
        found = self.product.get("/v1/runs?tag=stage%3Dfield&tag=baseline&text=three")["runs"]
        self.assertEqual([run["id"] for run in found], [job["run"]])
        self.assertEqual(found[0]["name"], "three seeds")
        self.assertEqual(found[0]["note"], "sticks at joint 3")
        self.assertEqual(found[0]["tags"], ["baseline", "bench=3", "stage=field"])
        self.assertEqual(client.get_run(run).info.status, status)

        label = [TORQUED, "label", "run", str(job["run"]), "--server", self.product.url]
        subprocess.run([*label, "--name", "ours", "--note", "said here", "--tag", "lr=1e-3"],
                       check=True, capture_output=True)
        (seen,) = self.own_runs("tags.lr = '1e-3' AND attributes.run_name = 'ours'")
        self.assertEqual(seen.info.run_id, run)
        self.assertEqual(seen.data.tags["mlflow.note.content"], "said here")
        self.assertEqual(seen.data.tags["torqued.tags"], "baseline bench=3 lr=1e-3 stage=field")
        self.assertEqual(seen.data.tags["baseline"], "")
        for key in ["baseline", "bench", "lr", "stage", "mlflow.runName", "mlflow.note.content"]:
            client.delete_tag(run, key)
        self.assertNotIn("torqued.tags", client.get_run(run).data.tags)
        self.assertNotEqual(client.get_run(run).info.run_name, "ours")

    def test_a_run_goes_through_its_whole_life(self):
        client = self.client
        experiment = client.create_experiment("life", tags={"team": "arms"})
        run = client.create_run(experiment, run_name="first", start_time=1_700_000_000_123)
        name = run.info.run_id
        values = [math.nan, math.inf, -math.inf, 0.1 + 0.2, 5e-324, 1.7976931348623157e308]
        metrics = [Metric("m", value, 2**63 - 1 - k, k) for k, value in enumerate(values)]
        many = [Metric("many", k / 7, k, k) for k in range(990)]
        client.log_batch(name, metrics + many, [Param("lr", "1e-3")], [RunTag("a b", "c")])
        client.log_metric(name, "alone", 3, step=-5)
        client.log_param(name, "alone", "x" * 6000)
        history = client.get_metric_history(name, "m")
        self.assertTrue(math.isnan(history[0].value))
        self.assertEqual([point.value for point in history[1:]], values[1:])
        self.assertEqual([point.timestamp for point in history], [2**63 - 1 - k for k in range(6)])
        self.assertEqual(client.get_metric_history(name, "alone")[0].step, -5)
        self.assertEqual(len(client.get_metric_history(name, "many")), 990)
        message = self.refused(
            "INVALID_PARAMETER_VALUE", client.log_batch, name, params=[Param("lr", "2")]
        )
        self.assertIn("lr", message)
        client.set_tag(name, "gone", "1")
        client.delete_tag(name, "gone")
        client.update_run(name, status="FAILED", name="renamed")
        client.set_terminated(name, "FINISHED", end_time=1_700_000_000_999)
        run = client.get_run(name)
        self.assertEqual(run.data.tags, {"a b": "c", "mlflow.runName": "renamed"})
        self.assertEqual(run.info.end_time, 1_700_000_000_999)
        client.delete_run(name)
        self.assertEqual(client.search_runs([experiment]), [])
        deleted = client.search_runs([experiment], run_view_type=ViewType.DELETED_ONLY)
        self.assertEqual([run.info.run_id for run in deleted], [name])
        client.restore_run(name)
        client.rename_experiment(experiment, "afterlife")
        client.set_experiment_tag(experiment, "team", "legs")
        found = client.search_experiments(filter_string="tags.team = 'legs'")
        self.assertEqual([found.name for found in found], ["afterlife"])
        client.delete_experiment(experiment)
        self.refused("INVALID_PARAMETER_VALUE", client.create_run, experiment)
        client.restore_experiment(experiment)
        self.refused("RESOURCE_ALREADY_EXISTS", client.create_experiment, "afterlife")
        self.refused("RESOURCE_DOES_NOT_EXIST", client.get_run, "unknown")

    def test_pages_of_a_search_have_every_run_once(self):
        experiment = self.client.create_experiment("pages")
        for k in range(7):
            run = self.client.create_run(experiment, run_name=f"run {k}")
            self.client.log_metric(run.info.run_id, "k", k)
        found, token = [], None
        while True:
            page = self.client.search_runs(
                [experiment], "metrics.k > 0", max_results=4, page_token=token,
                order_by=["metrics.k DESC"],
            )
            found += [run.info.run_name for run in page]
            token = page.token
            if not token:
                break
        self.assertEqual(found, [f"run {k}" for k in range(6, 0, -1)])

    def test_folders_of_files_go_there_and_back(self):
        experiment = self.client.create_experiment("files")
        run = self.client.create_run(experiment).info.run_id
        sent = pathlib.Path(self.folder.name, "sent")
        (sent / "deep/er").mkdir(parents=True)
        (sent / "large.bin").write_bytes(os.urandom(3_000_000))
        (sent / "deep/er/ä b.txt").write_text("here")
        self.client.log_artifacts(run, str(sent), "kept")
        back = pathlib.Path(self.client.download_artifacts(run, "kept", self.folder.name))
        for file in ["large.bin", "deep/er/ä b.txt"]:
            self.assertEqual((back / file).read_bytes(), (sent / file).read_bytes())
        listed = self.client.list_artifacts(run, "kept")
        self.assertEqual([(it.path, it.is_dir, it.file_size) for it in listed],
                         [("kept/deep", True, None), ("kept/large.bin", False, 3_000_000)])


if __name__ == "__main__":
    unittest.main()

"""Two Python clients submit, watch and download: one generated from the OpenAPI document, and torqued's own."""

import hashlib
import pathlib
import subprocess
import sys
import tempfile
import time
import unittest

from product import REPOSITORY, TORQUED, Server

sys.path.insert(0, str(REPOSITORY / "python"))
import torqued  # noqa: E402

# Files whose types the generator does not know are bytes.
CONFIG = """
content_type_overrides:
  application/xml: application/octet-stream
  image/svg+xml: application/octet-stream
  text/xml: application/octet-stream
  application/vnd.apache.parquet: application/octet-stream
  application/vnd.apache.arrow.stream: application/octet-stream
post_hooks: []
"""


class GeneratedClient(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.server = Server()
        cls.addClassCleanup(cls.server.stop)
        folder = tempfile.TemporaryDirectory(prefix="torqued-client-")
        cls.addClassCleanup(folder.cleanup)
        config = pathlib.Path(folder.name) / "config.yml"
        config.write_text(CONFIG)
        subprocess.run(
            [
                *(sys.executable, "-m", "openapi_python_client", "generate", "--meta", "none"),
                *("--url", f"{cls.server.url}/v1/openapi.json", "--config", str(config)),
                *("--output-path", f"{folder.name}/torqued_client"),
            ],
            check=True,
            capture_output=True,
        )
        sys.path.insert(0, folder.name)
        cls.addClassCleanup(sys.path.remove, folder.name)
        from torqued_client import Client

        cls.client = Client(base_url=cls.server.url)

    def test_a_preset_is_submitted_watched_and_downloaded(self):
        from torqued_client.api.datasets import get_dataset
        from torqued_client.api.jobs import get_job, post_jobs
        from torqued_client.models import SimulateJobFromPreset

        spec = SimulateJobFromPreset.from_dict({"preset": "D1-chirp", "trajectories": 8})
        job = post_jobs.sync(client=self.client, body=spec)
        for _ in range(600):
            job = get_job.sync(client=self.client, id=job.id)
            if job.state in ("succeeded", "failed", "cancelled"):
                break
            time.sleep(0.1)
        self.assertEqual(job.state, "succeeded")
        self.assertEqual(job.spec.trajectories, 8)

        dataset = get_dataset.sync(client=self.client, id=job.dataset)
        for file in dataset.files:
            # The generator supports one media type for each operation, and files have several.
            answer = self.client.get_httpx_client().get(file.url)
            self.assertEqual(answer.status_code, 200)
            self.assertEqual(len(answer.content), file.size)

    def test_a_spec_that_cannot_be_accepted_is_answered_with_its_violations(self):
        from torqued_client.api.jobs import post_jobs
        from torqued_client.models import Problem, SimulateJobFromPreset

        spec = SimulateJobFromPreset.from_dict({"preset": "D1-chirp", "trajectories": 0})
        problem = post_jobs.sync(client=self.client, body=spec)
        self.assertIsInstance(problem, Problem)
        self.assertEqual([it.field for it in problem.violations], ["trajectories"])


class OwnClient(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.server = Server()
        cls.addClassCleanup(cls.server.stop)
        cls.client = torqued.Client(cls.server.url)
        folder = tempfile.TemporaryDirectory(prefix="torqued-client-")
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)

    def test_a_job_gets_the_labels_that_it_is_submitted_with(self):
        spec = {"preset": "D1-chirp", "trajectories": 4}
        job = self.client.submit(spec, name="a few", note="*Chirps*.", tags=["b", "a/1"])
        self.assertEqual((job["name"], job["note"], job["tags"]), ("a few", "*Chirps*.", ["a/1", "b"]))
        again = self.client.submit(spec, tags="c")
        self.assertEqual((again["id"], again["name"], again["tags"]), (job["id"], "a few", ["a/1", "b", "c"]))
        self.client.wait(job)

    def test_the_files_of_a_run_are_downloaded_as_those_of_a_dataset_are(self):
        data = self.client.wait(self.client.submit({"preset": "D1-chirp", "trajectories": 8}))
        names = [path.name for path in self.client.download("dataset", data["dataset"], self.folder / "data")]
        self.assertIn("dataset.json", names)
        spec = {"kind": "evaluate", "data": {"dataset": data["dataset"]}, "baselines": ["hold-last"]}
        job = self.client.wait(self.client.submit(spec))
        run = self.client.evaluation(job["id"])["run"]
        files = self.client.download("run", run, self.folder / "run")
        self.assertIn("report.json", [path.name for path in files])
        self.assertEqual(
            {artifact["name"]: artifact["sha256"] for artifact in self.client.run(run)["artifacts"]},
            {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files},
        )
        same = self.client.download("evaluations", job["id"], self.folder / "run")
        self.assertEqual(sorted(same), sorted(files))

    def test_a_kind_without_files_is_refused(self):
        with self.assertRaisesRegex(ValueError, "'job', allowed: 'dataset', 'checkpoint', 'run', 'evaluation'"):
            self.client.download("job", 1, self.folder)

    def test_questions_go_to_the_checkpoint_with_their_options(self):
        for ask in (self.client.predict, self.client.torque):
            with self.assertRaises(torqued.ServerError) as refused:
                ask(1, [], position_noise_rad=1e-4, rate_hz=120)
            self.assertEqual(refused.exception.status, 404)
            with self.assertRaises(torqued.ServerError) as refused:
                ask(1, [], rate=120)
            self.assertEqual([it["field"] for it in refused.exception.problem["violations"]], ["rate"])

    def test_an_error_has_one_line_for_each_violation(self):
        with self.assertRaises(torqued.ServerError) as refused:
            self.client.submit({"preset": "D1-chirp", "trajectories": 0, "steps": 1})
        title, *lines = str(refused.exception).splitlines()
        self.assertEqual(title, "The spec is not allowed")
        self.assertEqual([line.split()[0] for line in sorted(lines)], ["steps:", "trajectories"])
        problem = {"violations": [{"field": "", "value": "", "allowed": "an object"}], "more_violations": 7}
        lines = str(torqued.ServerError(422, problem)).splitlines()
        self.assertEqual(lines, ["status 422", "the spec: an object", "and 7 more"])
        self.assertEqual(str(torqued.ServerError(502, {"detail": "Bad Gateway"})), "Bad Gateway")

    def test_who_has_no_token_is_told_where_to_put_one(self):
        server = Server()
        self.addCleanup(server.stop)
        create = [TORQUED, "token", "create", "ann", "--scope", "admin", "--server", server.url]
        subprocess.run(create, check=True, capture_output=True)
        with self.assertRaisesRegex(torqued.ServerError, "set TORQUED_TOKEN, or pass token to Client"):
            torqued.Client(server.url).get("/v1/jobs")


if __name__ == "__main__":
    unittest.main()

"""A Python client, generated from the OpenAPI document, submits, watches and downloads."""

import pathlib
import subprocess
import sys
import tempfile
import time
import unittest

from product import Server

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


if __name__ == "__main__":
    unittest.main()

"""The guide docs/guides/compare-your-model.md: a model in Python beside those of torqued."""

import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest
import urllib.error

import numpy
import polars
import pyarrow.compute
import pyarrow.parquet

from product import REPOSITORY, TORQUED, Product

sys.path.insert(0, str(REPOSITORY / "docs/examples"))
import ridge  # noqa: E402

ENVIRONMENT = {key: value for key, value in os.environ.items() if not key.startswith("TORQUED_")}


class ForeignModel(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.product = Product()
        cls.addClassCleanup(cls.product.stop)
        folder = tempfile.TemporaryDirectory(prefix="torqued-foreign-")
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)
        cls.grid = cls.product.member("test-grid")["dataset"]

    def imported(self, path):
        """The dataset that `torqued import` makes of a file of predictions."""
        command = [TORQUED, "import", path, "--predictions-of", str(self.grid), "--wait", "--server", self.product.url]
        done = subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        return self.product.get("/v1/datasets")["datasets"][0]["id"]

    def evaluated(self, predictions, **more):
        spec = {"kind": "evaluate", "data": {"dataset": self.grid}, "baselines": ["hold-last"], **more}
        spec["predictions"] = [{"name": name, "data": {"dataset": id}} for name, id in predictions.items()]
        job = self.product.post("/v1/jobs", spec)["id"]
        self.product.wait(job)
        return self.product.get(f"/v1/evaluations/{job}")["report"]

    def test_the_example_of_the_guide_is_scored_as_numpy_scores_it(self):
        path = self.folder / "my-ridge.parquet"
        script = REPOSITORY / "docs/examples/ridge.py"
        subprocess.run([sys.executable, script, self.product.url, path, "20"], check=True)
        report = self.evaluated({"my-ridge": self.imported(path)}, samples=20)

        scenarios = ridge.read(self.product.url, "test-grid")
        truth = ridge.channels(scenarios, ridge.Q)[:, ridge.CONTEXT :]
        rows = polars.read_parquet(path).filter(~polars.col("trajectory").str.contains("/"))
        error = ridge.channels(rows, ridge.Q) - truth
        expected = numpy.degrees(numpy.sqrt((error**2).mean(axis=1))).mean()
        (group,) = [group for group in report["groups"] if group["scenarios"] == len(truth)]
        rmse = {it["predictor"]: it["mean"] for it in group["rmse_deg"]}
        self.assertAlmostEqual(rmse["my-ridge"], expected, delta=1e-4 * expected)
        self.assertLess(rmse["my-ridge"], rmse["hold-last"])
        scores = next(it for it in group["scores"] if it["predictor"] == "my-ridge")
        self.assertGreater(scores["crps_deg"]["mean"], 0)

    def test_pyarrow_writes_the_horizon_of_a_dataset_as_predictions(self):
        dataset = self.product.get(f"/v1/datasets/{self.grid}")
        file = next(file for file in dataset["files"] if file["content"] == "trajectories")
        rows = pyarrow.parquet.read_table(self.product.download(file["url"], self.folder))
        horizon = rows.filter(pyarrow.compute.greater_equal(rows["step"], 320))
        path = self.folder / "truth.parquet"
        pyarrow.parquet.write_table(horizon, path)
        report = self.evaluated({"truth": self.imported(path)})
        for cell in report["cells"]:
            self.assertEqual(cell["rmse_deg"][1], {"predictor": "truth", "mean": 0, "low": 0, "high": 0})

    def test_a_name_that_is_taken_is_refused(self):
        with self.assertRaises(urllib.error.HTTPError) as refused:
            self.evaluated({"arx": self.grid})
        problem = json.load(refused.exception)
        self.assertIn("predictions[0].name", problem["detail"])
        self.assertIn("another name than that of a baseline", problem["detail"])


if __name__ == "__main__":
    unittest.main()

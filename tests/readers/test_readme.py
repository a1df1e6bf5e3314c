"""The commands and snippets of README.md, run as they are printed, and what README says that they print."""

import json
import os
import re
import subprocess
import tempfile
import unittest

from product import REPOSITORY, Quickstart
from tables import Table, differences

README = (REPOSITORY / "README.md").read_text()

# Other instruction sets add numbers in another order. A training or an iterated fit makes the difference larger, and so does an arm with
# little damping: a single one that a fit loses is most of an interval.
TRAINED = {"robomorph": 0.2, "lagrangian": 0.5, "identification": 0.5}


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


class Readme(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.product = Quickstart()
        cls.addClassCleanup(cls.product.stop)
        cls.folder = tempfile.TemporaryDirectory(prefix="torqued-readme-")
        cls.addClassCleanup(cls.folder.cleanup)

    def here(self, text):
        """The printed port, unless another server has it."""
        return text.replace("http://127.0.0.1:7070", self.product.url)

    def run_line(self, line):
        done = subprocess.run(
            ["bash", "-c", self.here(line).replace("curl ", "curl --fail --silent --show-error ", 1)],
            cwd=self.folder.name,
            capture_output=True,
            text=True,
        )
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout

    def test_1_the_quickstart_prints_the_table(self):
        (block,) = (block for block in blocks("text") if "RMSE in degrees" in block)
        documented, printed = Table(block), Table(self.product.printed)
        self.assertEqual(differences(documented, printed, TRAINED), [])
        others = len(printed.rows) - len(documented.rows)
        self.assertEqual((len(printed.rows), others), (8, 0))
        self.assertIn("six baselines", README)

    def test_1_no_baseline_is_better_than_the_model(self):
        printed = Table(self.product.printed).rows
        means = {name: (numbers[0], numbers[3]) for name, (numbers, _) in printed.items()}
        model = means["lagrangian"]
        better = {name for name, of in means.items() if of[0] < model[0] or of[1] < model[1]}
        self.assertEqual(better, set())
        self.assertIn("Its mean error is below those of `robomorph` and of all six baselines", README)

    def test_2_the_quickstart_again_computes_nothing(self):
        before = self.product.get("/v1/jobs")["jobs"]
        self.product.end()
        printed = self.product.quickstart()
        self.product.start()
        self.assertEqual(Table(printed).rows, Table(self.product.printed).rows)
        self.assertEqual([job["id"] for job in self.product.get("/v1/jobs")["jobs"]], [job["id"] for job in before])

    def test_3_the_five_curl_lines_answer_what_is_said_of_them(self):
        lines = [line for block in blocks("sh") for line in block.splitlines() if line.startswith("curl ")]
        self.assertEqual(len(lines), 5)
        presets, submitted, job, evaluation, weights = (self.run_line(line) for line in lines)
        self.assertIn("quickstart", [preset["name"] for preset in json.loads(presets)["presets"]])
        # The simulations are not repeated.
        members = {member["name"]: member for member in json.loads(submitted)["members"]}
        self.assertTrue(members["train-set"]["reused"] and members["test-grid"]["reused"])
        self.assertFalse(members["train"]["reused"])
        self.assertEqual(json.loads(job)["name"], "quickstart")
        self.assertEqual(len(json.loads(evaluation)["report"]["predictors"]), 8)
        self.assertEqual(weights, "")
        (saved,) = os.listdir(self.folder.name)
        self.assertIn(f"saves `{saved}`", README)

    def test_4_a_wrong_field_is_refused_with_its_value_and_what_is_allowed(self):
        body = json.dumps({"preset": "quickstart", "jobs": {"train": {"steps": 0}}})
        asked = f"curl --silent --json '{body}' {self.product.url}/v1/jobs"
        problem = json.loads(subprocess.run(["bash", "-c", asked], capture_output=True, check=True).stdout)
        violation = next(it for it in problem["violations"] if it["field"] == "jobs.train.steps")
        self.assertEqual(violation["value"], "0")
        self.assertIn("10000000", violation["allowed"])

    def test_5_the_polars_snippet_prints_400_samples(self):
        snippet = next(block for block in blocks("python") if "polars" in block)
        self.assertIn("# 400 samples at 60 Hz", snippet)
        done = subprocess.run(
            [str(REPOSITORY / ".venv/bin/python"), "-c", self.here(snippet)],
            cwd=self.folder.name,
            capture_output=True,
            text=True,
            env={**os.environ, "NO_PROXY": "127.0.0.1"},
        )
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("shape: (400, 2)", done.stdout)


if __name__ == "__main__":
    unittest.main()

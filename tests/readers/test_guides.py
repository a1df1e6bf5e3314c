"""The guides of docs/guides, tried as far as a minute allows: with their files, their snippets and shorter trainings."""

import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

from product import REPOSITORY, TORQUED, Product, Server
from tables import Table, differences

DOCUMENTS = REPOSITORY / "docs"
BASELINES_OF_RECORDINGS = 9


def blocks(guide, language):
    text = (DOCUMENTS / "guides" / guide).read_text()
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def run(command, folder, server):
    """Runs a command in `folder` with the program on the PATH. Returns its output."""
    environment = {
        **os.environ,
        "PATH": f"{pathlib.Path(TORQUED).parent}:{os.environ['PATH']}",
        "PYTHONPATH": str(REPOSITORY / "python"),
        "TORQUED_SERVER": server.url,
        "NO_PROXY": "127.0.0.1",
    }
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)


class Guide(unittest.TestCase):
    def begin(self, server):
        self.server = server
        self.addCleanup(server.stop)
        folder = tempfile.TemporaryDirectory(prefix="torqued-guide-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def succeed(self, *command):
        done = run(command, self.folder, self.server)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout


class Recordings(Guide):
    def test_from_a_log_to_a_prediction(self):
        self.begin(Server())
        self.succeed(sys.executable, DOCUMENTS / "examples/recordings.py")
        head, *_ = blocks("recordings.md", "text")
        self.assertEqual((self.folder / "train.csv").read_text().splitlines()[:2], head.splitlines())

        (mapping,) = blocks("recordings.md", "json")
        (self.folder / "mapping.json").write_text(mapping)
        (imports,) = (block for block in blocks("recordings.md", "sh") if "torqued import" in block)
        printed = self.succeed("bash", "-euc", imports)
        summary = next(block for block in blocks("recordings.md", "text") if "trajectories," in block)
        for line in summary.splitlines():
            self.assertIn(line, printed)

        (self.folder / "wrong.json").write_text(mapping.replace('"deg"', '"rad"'))
        refused = run(["torqued", "import", "train.csv", "--spec", "wrong.json", "--wait"], self.folder, self.server)
        self.assertEqual(refused.returncode, 3)
        said = next(block for block in blocks("recordings.md", "text") if "units.angle" in block)
        without_id = said.strip().split(" failed: ")[1]
        self.assertIn(without_id, refused.stdout)

        spec = json.loads((DOCUMENTS / "examples/recordings.json").read_text())
        for name in ("on-recordings", "on-simulated-arms"):
            spec["jobs"][name]["steps"] = 20
            spec["jobs"][name]["optimizer"]["warmup_steps"] = 0
        spec["jobs"]["simulated-arms"]["trajectories"] = 128
        (self.folder / "spec.json").write_text(json.dumps(spec))
        printed = Table(self.succeed("torqued", "submit", "--watch", "spec.json"))
        documented = Table(next(block for block in blocks("recordings.md", "text") if "RMSE in degrees" in block))
        self.assertEqual(set(documented.rows), set(printed.rows))
        # The models were trained for less.
        trained = {"prefix-transformer": float("inf"), "lagrangian": float("inf")}
        self.assertEqual(len(documented.rows) - len(trained), BASELINES_OF_RECORDINGS)
        self.assertEqual(differences(documented, printed, trained), [])

        (snippet,) = blocks("recordings.md", "python")
        said = self.succeed(sys.executable, "-c", snippet)
        self.assertRegex(said, r"^joint 4 after 0\.8 s: \S+ rad, 90 % between \S+ and \S+; it was -1\.8832\n$")


class Urdf(Guide):
    def test_from_a_urdf_and_a_log_to_a_model(self):
        self.begin(Server())
        self.succeed(sys.executable, DOCUMENTS / "examples/my_arm.py")
        identify, parameters, keep, compare = (
            block for block in blocks("urdf.md", "sh") if "my_arm.py" not in block and "serve" not in block
        )
        said, said_parameters, said_robots, said_errors = blocks("urdf.md", "text")
        self.assertAlike(said, self.succeed("bash", "-euc", identify))
        self.assertAlike(said_parameters, self.succeed("bash", "-euc", parameters))

        whole, job, windows = blocks("urdf.md", "json")
        for name, text in [("whole", whole), ("identify", job), ("windows", windows)]:
            (self.folder / f"{name}.json").write_text(text)
        printed = self.succeed("bash", "-euc", keep)
        for line in said_robots.splitlines():
            # Digests and ages differ.
            self.assertIn(" ".join(line.split()[:6]), " ".join(printed.split()))
        printed = self.succeed("bash", "-euc", compare)
        rows = Table(said_errors).rows
        self.assertEqual(differences(Table(said_errors), Table(printed), dict.fromkeys(rows, 0.05)), [])

    def assertAlike(self, said, printed):
        """Every line is printed, with numbers within 5 %: vectors of other widths sum in another order."""
        number = re.compile(r"-?\d+\.\d+(?:e-?\d+)?")
        words = lambda line: number.sub("#", " ".join(line.split()))
        numbers = lambda line: [float(found) for found in number.findall(line)]
        is_alike = lambda line, other: words(line) == words(other) and all(
            abs(value - expected) <= 0.05 * abs(expected) for value, expected in zip(numbers(other), numbers(line))
        )
        for line in said.splitlines():
            self.assertTrue(any(is_alike(line, other) for other in printed.splitlines()), f"{line!r} is not in {printed}")


class ControlLoop(Guide):
    def setUp(self):
        self.begin(Product())

    def test_the_loop_gets_a_prediction_for_every_sample_on_both_ways(self):
        happened = next(
            line
            for block in blocks("control-loop.md", "text")
            for line in block.splitlines()
            if line.endswith("has left it")
        )
        for way in ([], ["--websocket"]):
            with self.subTest(way=way):
                printed = self.succeed(sys.executable, DOCUMENTS / "examples/control_loop.py", "8", *way)
                self.assertIn(happened, printed.splitlines())
                self.assertIn("600 predictions, ", printed)
                self.assertEqual(printed.count("mean error"), 3)

    def test_the_first_question_is_answered_as_printed(self):
        question = next(block for block in blocks("control-loop.md", "sh") if block.startswith("jq "))
        opened, context = self.succeed("bash", "-euc", question).splitlines()
        said = next(block for block in blocks("control-loop.md", "text") if block.startswith('{"opened"'))
        said_opened, said_context = said.splitlines()
        self.assertEqual(context, said_context)
        found, documented = json.loads(opened)["opened"], json.loads(said_opened)["opened"]
        for changing in ("digest", "weights", "threads"):
            self.assertTrue(found.pop(changing) and documented.pop(changing))
        self.assertEqual(found, documented)

    def test_a_torque_is_chosen_among_candidates(self):
        printed = self.succeed(sys.executable, DOCUMENTS / "examples/choose_torque.py", "8")
        self.assertRegex(printed, r"^[+-]\d\.\d\d N·m moves joint 4 to \S+ rad; the goal is -0\.931 rad\n33 candidates took ")


if __name__ == "__main__":
    unittest.main()

"""Runs the example of docs/prediction.md and the command on a checkpoint's page, as printed."""

import html
import json
import os
import re
import subprocess
import unittest
import urllib.request

from product import REPOSITORY, Product

DOCUMENT = (REPOSITORY / "docs/prediction.md").read_text()


class Prediction(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.product = Product()
        cls.addClassCleanup(cls.product.stop)

    def test_the_controllers_loop_gets_a_prediction_for_every_sample(self):
        lines = self.printed_by("connect(")
        self.assertEqual([int(line.split()[0]) for line in lines], list(range(320, 380)))

    def test_the_client_gets_a_prediction_and_the_torques_of_a_motion(self):
        positions, torques = map(json.loads, self.printed_by("client.torque("))
        self.assertEqual((len(positions), len(torques)), (7, 7))

    def printed_by(self, part):
        """The lines that the document's snippet with `part` prints."""
        snippets = re.findall(r"```python\n(.*?)```", DOCUMENT, flags=re.DOTALL)
        (snippet,) = (snippet for snippet in snippets if part in snippet)
        snippet = snippet.replace("127.0.0.1:7070", self.product.url.removeprefix("http://"))
        done = subprocess.run(
            [str(REPOSITORY / ".venv/bin/python"), "-c", snippet],
            capture_output=True,
            text=True,
            env={**os.environ, "NO_PROXY": "127.0.0.1", "PYTHONPATH": str(REPOSITORY / "python")},
        )
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout.splitlines()

    def test_the_command_on_the_page_predicts(self):
        with urllib.request.urlopen(f"{self.product.url}/checkpoints/8") as answer:
            page = html.unescape(answer.read().decode())
        command = re.search(r"<h2>Predict</h2>\s*<pre>(.*?)</pre>", page, flags=re.DOTALL).group(1)
        done = subprocess.run(
            ["bash", "-c", command.replace("curl ", "curl --fail --silent ", 1)],
            capture_output=True,
            text=True,
        )
        self.assertEqual(done.returncode, 0, done.stderr)
        y = json.loads(done.stdout)["scenarios"][0]["y"]
        self.assertEqual((len(y), len(y[0])), (80, 7))


if __name__ == "__main__":
    unittest.main()

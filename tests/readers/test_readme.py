"""Runs the commands and snippets of README.md, as printed."""

import os
import re
import subprocess
import tempfile
import unittest

from product import REPOSITORY, Product

README = (REPOSITORY / "README.md").read_text()


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


class Readme(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.product = Product()
        cls.addClassCleanup(cls.product.stop)
        cls.folder = tempfile.TemporaryDirectory(prefix="torqued-readme-")
        cls.addClassCleanup(cls.folder.cleanup)

    def here(self, text):
        """The printed port, unless another server has it."""
        return text.replace("http://127.0.0.1:7070", self.product.url)

    def test_the_five_curl_lines_work(self):
        lines = [line for block in blocks("sh") for line in block.splitlines()]
        lines = [line for line in lines if line.startswith("curl ")]
        self.assertEqual(len(lines), 5)
        for line in lines:
            with self.subTest(line=line):
                done = subprocess.run(
                    ["bash", "-c", self.here(line).replace("curl ", "curl --fail ", 1)],
                    cwd=self.folder.name,
                    capture_output=True,
                    text=True,
                )
                self.assertEqual(done.returncode, 0, done.stderr)

    def test_the_polars_snippet_works(self):
        snippet = next(block for block in blocks("python") if "polars" in block)
        done = subprocess.run(
            [str(REPOSITORY / ".venv/bin/python"), "-c", self.here(snippet)],
            cwd=self.folder.name,
            capture_output=True,
            text=True,
            env={**os.environ, "NO_PROXY": "127.0.0.1"},
        )
        self.assertEqual(done.returncode, 0, done.stderr)


if __name__ == "__main__":
    unittest.main()

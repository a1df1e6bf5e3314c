"""docs/notebooks/first-steps.ipynb, run from its first cell to its last against a server of its own."""

import json
import os
import re
import tempfile
import unittest

import nbclient
import nbformat

from product import REPOSITORY, Server

NOTEBOOK = REPOSITORY / "docs/notebooks/first-steps.ipynb"
LARGEST_BYTES = 300_000

# Runs after the last cell, in the same kernel.
RESULTS = """
import json
json.dumps({
    "errors": {name: dict(zip(errors["predictor"], errors["mean"])) for (name,), errors in errors.group_by("group")},
    "samples": arm.height,
    "horizon": mean.shape,
    "is_ordered": bool((low <= high).all()),
    "width_deg": float(np.degrees(high - low)[-1, joint]),
    "rmse_deg": float(rmse_deg.mean()),
    "covered": float(covered),
    "difference_deg": float(difference_deg),
})
"""


def images(notebook):
    """The PNG figures among the outputs of a notebook, by the id of their cell."""
    return {
        cell.id: output.data["image/png"]
        for cell in notebook.cells
        for output in cell.get("outputs", ())
        if "image/png" in output.get("data", ())
    }


class Notebook(unittest.TestCase):
    def test_every_cell_runs_and_gives_its_result(self):
        server = Server()
        self.addCleanup(server.stop)
        folder = tempfile.TemporaryDirectory(prefix="torqued-notebook-")
        self.addCleanup(folder.cleanup)
        notebook = nbformat.read(NOTEBOOK, as_version=4)
        notebook.cells.append(nbformat.v4.new_code_cell(RESULTS))
        environment = {
            **os.environ,
            "TORQUED_SERVER": server.url,
            "PYTHONPATH": str(REPOSITORY / "python"),
            "NO_PROXY": "127.0.0.1",
        }
        client = nbclient.NotebookClient(
            notebook,
            timeout=120,
            kernel_name="python3",
            resources={"metadata": {"path": folder.name}},
        )
        # Raises with the cell and its traceback if one fails.
        client.execute(env=environment)

        self.assertEqual(list(images(notebook)), ["figure"])
        text = notebook.cells[-1].outputs[0].data["text/plain"]
        found = json.loads(text.strip("'"))
        for group, means in found["errors"].items():
            for baseline in ("hold-last", "damped-integrator", "arx"):
                with self.subTest(group=group, baseline=baseline):
                    self.assertLess(means["lagrangian"], means[baseline] / 3)
        self.assertEqual(set(found["errors"]), {"in distribution", "out of distribution"})
        self.assertEqual(found["samples"], 400)
        self.assertEqual(found["horizon"], [80, 7])
        self.assertTrue(found["is_ordered"])
        self.assertGreater(found["width_deg"], 0.1)
        self.assertLess(found["rmse_deg"], 2.0)
        self.assertGreater(found["covered"], 0.7)
        self.assertLess(found["difference_deg"], 1e-3)

    def test_it_is_committed_with_its_figure_and_is_small(self):
        self.assertLess(NOTEBOOK.stat().st_size, LARGEST_BYTES)
        notebook = nbformat.read(NOTEBOOK, as_version=4)
        nbformat.validate(notebook)
        self.assertEqual(list(images(notebook)), ["figure"])
        outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
        self.assertFalse([output for output in outputs if output.get("name") == "stderr"])
        self.assertFalse([output for output in outputs if output.output_type == "error"])

    def test_its_links_lead_to_files(self):
        notebook = nbformat.read(NOTEBOOK, as_version=4)
        text = "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "markdown")
        links = [link.split("#")[0] for link in re.findall(r"\]\(([^)]+)\)", text)]
        missing = [link for link in links if "://" not in link and not (NOTEBOOK.parent / link).is_file()]
        self.assertGreater(len(links), 5)
        self.assertEqual(missing, [])


if __name__ == "__main__":
    unittest.main()

"""Checkpoints in PyTorch: `torqued.load`, `torqued.save` and predictions. No server is needed."""

import json
import pathlib
import shutil
import sys
import tempfile
import unittest

import numpy

from product import REPOSITORY

sys.path.insert(0, str(REPOSITORY / "python"))
import torqued  # noqa: E402

DATA = REPOSITORY / "crates/models/tests/data"


class Checkpoints(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="torqued-checkpoints-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def checkpoint(self, name, **fields):
        """A copy of a checkpoint of the tests of models, with these fields in its config."""
        folder = self.folder / name
        shutil.copytree(DATA / name, folder)
        path = folder / "config.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | fields))
        return folder

    def test_a_law_that_pytorch_lacks_is_refused_with_the_way_to_its_predictions(self):
        model = json.loads((DATA / "lagrangian/config.json").read_text())["model"]
        told = model | {"robot": {"model": "panda", "gravity": "on"}, "rotor_inertia": True, "disturbance": False}
        with self.assertRaises(NotImplementedError) as refused:
            torqued.load(self.checkpoint("lagrangian", model=told))
        self.assertIn("no lagrangian with robot and rotor_inertia; ask torqued", str(refused.exception))
        self.assertIn("Client.predict", str(refused.exception))

    def test_changed_weights_are_saved_without_the_metrics_of_those_they_began_from(self):
        ranges = {"u_nm": [[-1.0, 1.0]] * 7, "y_rad": [[-1.0, 1.0]] * 7, "rate_rad_s": [[-1.0, 1.0]] * 7}
        described = {"step": 200, "spec_digest": "ab" * 32, "metrics": {"train/loss": 0.5}, "ranges": ranges}
        folder = self.checkpoint("gru", **described)
        before = json.loads((folder / "config.json").read_text())
        model = torqued.load(folder)
        saved = self.folder / "saved"
        torqued.save(model, saved)
        self.assertEqual(json.loads((saved / "config.json").read_text()), before)

        next(model.network.parameters()).data += 0.1
        torqued.save(model, saved)
        changed = json.loads((saved / "config.json").read_text())
        self.assertNotIn("metrics", changed)
        self.assertEqual((changed["spec_digest"], changed["step"]), ("pytorch", 0))
        self.assertEqual(changed["init"], {"spec_digest": "ab" * 32, "step": 200})
        self.assertEqual((changed["ranges"], changed["model"]), (ranges, before["model"]))
        torqued.save(torqued.load(saved), self.folder / "again")
        self.assertEqual(json.loads((self.folder / "again/config.json").read_text()), changed)

    def test_one_robot_without_a_batch_is_refused_with_the_shapes_that_are_allowed(self):
        model = torqued.load(DATA / "robomorph")
        samples, context = model.config["samples"], model.config["context"]
        u, y = numpy.zeros((samples, 7)), numpy.zeros((context, 7))
        with self.assertRaises(ValueError) as refused:
            model.predict(u, y)
        self.assertIn(f"allowed: [batch, {samples}, 7] and [batch, {context}, 7]", str(refused.exception))
        self.assertIn("u[None], y_context[None]", str(refused.exception))
        self.assertEqual(model.predict(u[None], y[None]).shape, (1, samples - context, 7))


if __name__ == "__main__":
    unittest.main()

"""Reads `torqued export --lerobot` by the documentation of LeRobot's format v3.0, and checks the layout of the
Hugging Face hub."""

import json
import pathlib
import subprocess
import tempfile
import unittest

import numpy
import pyarrow.parquet
import safetensors.numpy

from product import TORQUED, Product


class Exports(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.product = Product()
        cls.addClassCleanup(cls.product.stop)
        cls.folder = tempfile.TemporaryDirectory(prefix="torqued-exports-")
        cls.addClassCleanup(cls.folder.cleanup)

    def export(self, *arguments):
        command = [TORQUED, "export", *arguments, "--server", self.product.url]
        subprocess.run(command, check=True, capture_output=True)

    def test_a_dataset_has_an_episode_for_each_trajectory(self):
        dataset = self.product.member("train-set")["dataset"]
        root = pathlib.Path(self.folder.name) / "lerobot"
        self.export("--lerobot", str(dataset), str(root))
        info = json.loads((root / "meta/info.json").read_text())
        self.assertEqual((info["codebase_version"], info["fps"]), ("v3.0", 60))
        self.assertEqual((info["total_episodes"], info["total_frames"]), (2048, 2048 * 400))
        self.assertEqual(info["features"]["action"]["names"], [f"u{k}" for k in range(1, 8)])
        self.assertEqual(info["features"]["observation.state"]["info"], {"unit": "rad"})

        tasks = pyarrow.parquet.read_table(root / "meta/tasks.parquet")
        self.assertEqual(json.loads(tasks.schema.metadata[b"pandas"])["index_columns"], ["__index_level_0__"])
        episodes = pyarrow.parquet.read_table(root / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
        self.assertEqual(len(episodes), info["total_episodes"])
        source = [file for file in self.product.get(f"/v1/datasets/{dataset}")["files"] if file["content"] == "trajectories"]
        for number in (0, 1023, 1024, 2047):
            episode = episodes[number]
            self.assertEqual((episode["episode_index"], episode["length"]), (number, 400))
            path = root / info["data_path"].format(
                chunk_index=episode["data/chunk_index"], file_index=episode["data/file_index"]
            )
            rows = pyarrow.parquet.read_table(path, filters=[("episode_index", "==", number)])
            self.assertEqual(rows["index"].to_pylist(), list(range(episode["dataset_from_index"], episode["dataset_to_index"])))
            self.assertTrue(numpy.allclose(rows["timestamp"].to_numpy(), numpy.arange(400) / 60))
            original = self.product.download(source[number // 1024]["url"], self.folder.name)
            original = pyarrow.parquet.read_table(original, filters=[("trajectory", "==", number)])
            for key, symbol in (("observation.state", "q"), ("action", "u")):
                expected = numpy.stack([original[f"{symbol}{k}"].to_numpy() for k in range(1, 8)], axis=1)
                self.assertTrue((numpy.array(rows[key].to_pylist(), dtype=numpy.float32) == expected).all())

        stats = json.loads((root / "meta/stats.json").read_text())["action"]
        actions = [
            numpy.array(pyarrow.parquet.read_table(path)["action"].to_pylist())
            for path in sorted((root / "data").glob("*/*.parquet"))
        ]
        actions = numpy.concatenate(actions)
        self.assertEqual(stats["count"], [len(actions)])
        for key, expected in (("mean", actions.mean(0)), ("std", actions.std(0)), ("min", actions.min(0)), ("max", actions.max(0))):
            self.assertTrue(numpy.allclose(stats[key], expected, rtol=1e-5, atol=1e-6), key)

    def test_a_checkpoint_has_weights_and_a_card(self):
        checkpoint = max(self.product.member("train")["checkpoints"])
        root = pathlib.Path(self.folder.name) / "hub"
        self.export("--hugging-face", str(checkpoint), str(root))
        self.assertEqual({path.name for path in root.iterdir()}, {"README.md", "config.json", "model.safetensors"})
        card = (root / "README.md").read_text()
        self.assertTrue(card.startswith("---\nlibrary_name: torqued\n"), card)
        self.assertGreater(len(safetensors.numpy.load_file(root / "model.safetensors")), 10)


if __name__ == "__main__":
    unittest.main()

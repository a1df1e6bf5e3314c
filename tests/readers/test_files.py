"""Reads torqued's files with the libraries that notebooks use."""

import hashlib
import io
import json
import os
import pathlib
import re
import subprocess
import sys
import tarfile
import tempfile
import unittest
import urllib.request

import duckdb
import fsspec
import numpy
import polars
import pyarrow.dataset
import pyarrow.parquet
import safetensors.numpy

from product import REPOSITORY, TORQUED, Product, Server

CHANNELS = [f"u{k}" for k in range(1, 8)] + [f"q{k}" for k in range(1, 8)]


class Remote(io.RawIOBase):
    """A file behind an address. Only the ranges that somebody reads are fetched."""

    def __init__(self, url, size):
        self.url, self.size, self.position, self.read_bytes = url, size, 0, 0

    def readable(self):
        return True

    def seekable(self):
        return True

    def tell(self):
        return self.position

    def seek(self, offset, whence=io.SEEK_SET):
        self.position = offset + {io.SEEK_SET: 0, io.SEEK_CUR: self.position, io.SEEK_END: self.size}[whence]
        return self.position

    def read(self, count=-1):
        end = self.size if count < 0 else min(self.position + count, self.size)
        if end <= self.position:
            return b""
        headers = {"range": f"bytes={self.position}-{end - 1}"}
        with urllib.request.urlopen(urllib.request.Request(self.url, headers=headers)) as answer:
            assert answer.status == 206, answer.status
            data = answer.read()
        self.position += len(data)
        self.read_bytes += len(data)
        return data


class Files(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.product = Product()
        cls.addClassCleanup(cls.product.stop)
        cls.folder = tempfile.TemporaryDirectory(prefix="torqued-downloads-")
        cls.addClassCleanup(cls.folder.cleanup)
        simulation = cls.product.member("train-set")
        cls.dataset = cls.product.get(f"/v1/datasets/{simulation['dataset']}")
        cls.paths = {}
        for file in cls.dataset["files"]:
            path = cls.product.download(file["url"], cls.folder.name)
            cls.paths.setdefault(file["content"], []).append((file, path))

    def test_downloads_have_the_size_and_digest_that_the_api_states(self):
        for files in self.paths.values():
            for file, path in files:
                data = path.read_bytes()
                self.assertEqual(len(data), file["size"])
                self.assertEqual(hashlib.sha256(data).hexdigest(), file["sha256"])

    def test_polars_reads_one_row_per_time_step(self):
        frame = polars.concat(polars.read_parquet(path) for _, path in self.paths["trajectories"])
        self.assertEqual(frame.height, 2048 * 400)
        self.assertEqual(frame.schema["trajectory"], polars.Int32)
        self.assertEqual(frame.schema["step"], polars.Int32)
        for channel in CHANNELS:
            self.assertEqual(frame.schema[channel], polars.Float32)
        self.assertEqual(frame["trajectory"].n_unique(), 2048)
        values = frame.select(CHANNELS).to_numpy()
        self.assertTrue(numpy.isfinite(values).all())
        # Joint limits of the arm. No position may lie beyond the widest of them.
        self.assertLess(frame.select(polars.col("^q.$").abs().max()).to_numpy().max(), 3.8)

    def test_polars_scans_shards_by_url(self):
        urls = [self.product.url + file["url"] for file, _ in self.paths["trajectories"]]
        scan = polars.scan_parquet(urls).select("trajectory", "q1")
        self.assertEqual(scan.select(polars.len()).collect().item(), 2048 * 400)
        local = polars.concat(polars.read_parquet(path) for _, path in self.paths["trajectories"])
        last = scan.filter(polars.col("trajectory") == 2047).collect()
        expected = local.filter(polars.col("trajectory") == 2047).select("trajectory", "q1")
        self.assertTrue(last.equals(expected))

    def test_duckdb_asks_shards_by_url(self):
        urls = [self.product.url + file["url"] for file, _ in self.paths["trajectories"]]
        shards = pyarrow.dataset.dataset(urls, filesystem=fsspec.filesystem("http"))
        self.assertEqual(shards.count_rows(), 2048 * 400)
        asked = duckdb.sql("select step, q1 from shards where trajectory = 2047 order by step")
        local = polars.concat(polars.read_parquet(path) for _, path in self.paths["trajectories"])
        expected = local.filter(polars.col("trajectory") == 2047).select("step", "q1")
        self.assertEqual(asked.fetchall(), expected.rows())

    def test_pyarrow_reads_a_row_group_by_url_without_the_rest(self):
        file, path = self.paths["trajectories"][0]
        remote = Remote(self.product.url + file["url"], file["size"])
        group = pyarrow.parquet.ParquetFile(remote).read_row_group(0, columns=["q1"])
        self.assertTrue(group.equals(pyarrow.parquet.ParquetFile(path).read_row_group(0, columns=["q1"])))
        self.assertLess(remote.read_bytes, file["size"] / 2)

    def test_the_tar_of_a_dataset_has_its_files(self):
        path = self.product.download(f"/v1/datasets/{self.dataset['id']}/tar", self.folder.name)
        with tarfile.open(path) as archive:
            for file in self.dataset["files"]:
                data = archive.extractfile(f"dataset-{self.dataset['id']}/{file['name']}").read()
                self.assertEqual(hashlib.sha256(data).hexdigest(), file["sha256"])

    def test_pyarrow_finds_the_encodings_that_make_the_files_small(self):
        for _, path in self.paths["trajectories"]:
            metadata = pyarrow.parquet.ParquetFile(path).metadata
            group = metadata.row_group(0)
            columns = {
                group.column(k).path_in_schema: group.column(k) for k in range(group.num_columns)
            }
            for name in ("trajectory", "step"):
                self.assertIn("DELTA_BINARY_PACKED", columns[name].encodings)
            for name in CHANNELS:
                self.assertIn("BYTE_STREAM_SPLIT", columns[name].encodings)
                self.assertFalse(columns[name].has_dictionary_page)
                self.assertEqual(columns[name].compression, "ZSTD")
            self.assertEqual(group.num_rows % 400, 0, "a row group holds whole trajectories")

    def test_the_robot_table_has_one_row_per_trajectory(self):
        tables = [pyarrow.parquet.read_table(path) for _, path in self.paths["robots"]]
        self.assertEqual(sum(table.num_rows for table in tables), 2048)
        self.assertIn("trajectory", tables[0].column_names)

    def test_the_checkpoint_opens_as_safetensors_with_finite_weights(self):
        checkpoint = max(self.product.member("train")["checkpoints"])
        files = self.product.get(f"/v1/checkpoints/{checkpoint}")["files"]
        weights = next(file for file in files if file["name"] == "model.safetensors")
        path = self.product.download(weights["url"], self.folder.name)
        tensors = safetensors.numpy.load_file(path)
        self.assertGreater(len(tensors), 10)
        for name, tensor in tensors.items():
            self.assertTrue(numpy.isfinite(tensor).all(), name)

    def test_polars_reads_one_row_per_scenario_joint_and_predictor(self):
        evaluation = self.product.get(f"/v1/evaluations/{self.product.member('evaluate')['id']}")
        artifacts = {artifact["name"]: artifact for artifact in evaluation["artifacts"]}
        path = self.product.download(artifacts["scenarios.parquet"]["url"], self.folder.name)
        frame = polars.read_parquet(path)
        report = evaluation["report"]
        predictors = [predictor["name"] for predictor in report["predictors"]]
        scenarios = sum(cell["scenarios"] for cell in report["cells"])
        self.assertEqual(frame.height, scenarios * 7 * len(predictors))
        self.assertEqual(frame.schema["predictor"], polars.String)
        self.assertEqual(frame.schema["rmse_deg"], polars.Float32)
        self.assertEqual(set(frame["joint"]), set(range(1, 8)))
        self.assertEqual(frame["crps_deg"].null_count(), frame.height, "one sample is none")
        for cell in report["cells"]:
            for stated in cell["rmse_deg"]:
                rows = frame.filter(
                    (polars.col("predictor") == stated["predictor"])
                    & (polars.col("frequency_hz") == cell["frequency_hz"])
                )
                self.assertAlmostEqual(rows["rmse_deg"].mean(), stated["mean"], places=4)
        footer = pyarrow.parquet.ParquetFile(path).metadata.metadata
        columns = [column["name"] for column in json.loads(footer[b"torqued.columns"])]
        self.assertEqual(columns, frame.columns)


class ArmOfSix(unittest.TestCase):
    def test_polars_finds_six_torques_and_six_positions(self):
        spec = {
            "kind": "simulate",
            "trajectories": 4,
            "samples": 60,
            "robot": {"model": json.loads((REPOSITORY / "tests/data/arm_of_six.json").read_text())},
            "excitation": {"multisine": {"frequency_hz": {"fixed": 0.15}}},
        }
        with tempfile.TemporaryDirectory(prefix="torqued-six-") as folder:
            folder = pathlib.Path(folder)
            (folder / "spec.json").write_text(json.dumps(spec))
            command = [TORQUED, "simulate", "--spec", folder / "spec.json", "--out", folder / "six"]
            subprocess.run(command, check=True, capture_output=True)
            frame = polars.read_parquet(folder / "six" / "trajectories-00000.parquet")
            robots = pyarrow.parquet.read_table(folder / "six" / "robots-00000.parquet")
        channels = [f"u{k}" for k in range(1, 7)] + [f"q{k}" for k in range(1, 7)]
        self.assertEqual(frame.columns, ["trajectory", "step", *channels])
        self.assertEqual(frame.height, 4 * 60)
        self.assertTrue(numpy.isfinite(frame.select(channels).to_numpy()).all())
        self.assertEqual(robots.num_rows, 4)


class FilesBehindAToken(unittest.TestCase):
    def test_polars_reads_shards_in_place_with_the_token(self):
        token = "0123456789abcdef0123"
        server = Server("--token", token)
        self.addCleanup(server.stop)
        environment = {**os.environ, "TORQUED_SERVER": server.url, "TORQUED_TOKEN": token}
        spec = json.dumps({"preset": "D1-chirp", "trajectories": 8, "shard_trajectories": 2})
        submit = [TORQUED, "submit", "-", "--watch"]
        subprocess.run(submit, input=spec, text=True, check=True, capture_output=True, env=environment)
        document = (REPOSITORY / "docs/downloads.md").read_text()
        (snippet,) = (it for it in re.findall(r"```python\n(.*?)```", document, re.DOTALL) if "TORQUED_TOKEN" in it)
        snippet = snippet.replace("http://127.0.0.1:7070", server.url).replace("datasets/3", "datasets/1")
        *lines, last = snippet.replace("== 1200", "== 5").splitlines()
        code = "\n".join([*lines, f"print(({last}).shape)"])
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(done.stdout, "(400, 2)\n")


if __name__ == "__main__":
    unittest.main()

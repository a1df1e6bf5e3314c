"""The Python client sends recordings, which become a dataset."""

import pathlib
import sys
import tempfile
import unittest

import numpy
import polars

from product import REPOSITORY, Server

sys.path.insert(0, str(REPOSITORY / "python"))
import torqued  # noqa: E402

MAPPING = {
    "columns": {"time": "t", "u": ["u"], "q": ["q"]},
    "rate_hz": 100,
    "samples": 50,
    "split": {"kind": "windows", "stride": 50},
}


class Recordings(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.server = Server()
        cls.addClassCleanup(cls.server.stop)
        cls.client = torqued.Client(cls.server.url)
        folder = tempfile.TemporaryDirectory(prefix="torqued-recordings-")
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)

    def log(self, name, rows, phase=0.0):
        t = numpy.arange(rows) / 100
        joints = numpy.arange(7)
        path = self.folder / name
        q, u = (numpy.sin(t[:, None] + joints + phase + shift) for shift in (0, 1))
        numpy.savez(path, t=t, q=q, u=u)
        return path

    def test_several_logs_become_one_dataset(self):
        logs = [self.log("monday.npz", 120), self.log("tuesday.npz", 60, 0.5)]
        job = self.client.wait(self.client.import_recordings(*logs, mapping=MAPPING), timeout_s=60)
        self.assertEqual([it["name"] for it in job["spec"]["files"]], ["monday", "tuesday"])
        dataset = self.client.dataset(job["dataset"])
        self.assertEqual((dataset["name"], dataset["trajectories"]), ("monday, tuesday", 3))
        self.client.download("datasets", job["dataset"], self.folder / "data")
        table = polars.read_parquet(self.folder / "data/robots-00000.parquet")
        self.assertEqual(table["recording"].to_list(), ["monday", "monday", "tuesday"])
        self.assertEqual(self.client.import_recordings(*logs, mapping=MAPPING)["id"], job["id"])

    def test_what_is_refused_says_why_also_before_a_large_file_is_sent(self):
        large = self.folder / "large.npz"
        large.write_bytes(bytes(64 << 20))
        with self.assertRaisesRegex(torqued.ServerError, "samples is 1, allowed: 2 to 10000"):
            self.client.import_recordings(large, mapping={**MAPPING, "samples": 1})
        log = self.log("twice.npz", 60)
        with self.assertRaisesRegex(torqued.ServerError, "files.name"):
            self.client.import_recordings(log, log, mapping=MAPPING)
        with self.assertRaisesRegex(ValueError, "one or more paths"):
            self.client.import_recordings(mapping=MAPPING)


if __name__ == "__main__":
    unittest.main()

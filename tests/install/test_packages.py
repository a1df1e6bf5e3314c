"""Installs the packages of dist/ where nothing else is installed: a wheel in a clean environment, a .deb in an
empty root."""

import gzip
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

import product
from product import REPOSITORY, SPEC, Server

# The baseline of x86-64: no SSSE3, no AVX.
BASELINE = ["qemu-x86_64", "-cpu", "qemu64"]

# The Python of the wheel's environment runs this.
NOTEBOOK = """
import json, pathlib, sys
import torqued

client = torqued.Client()
try:
    client.submit({"preset": "D1-chirp", "trajectories": 0})
except torqued.ServerError as error:
    refused = str(error)
pipeline = client.wait(client.submit(json.loads(sys.argv[1])))
members = {it["name"]: client.job(it["job"]) for it in pipeline["members"]}
dataset = client.dataset(members["train-set"]["dataset"])
files = client.download("datasets", dataset["id"], sys.argv[2])
training = members["train"]
weights = client.download("checkpoints", training["checkpoints"][-1], sys.argv[3])
try:
    torqued.load(sys.argv[3])
    needs = None
except ImportError as error:
    needs = str(error)
print(json.dumps({
    "refused": refused,
    "files": [file.name for file in files],
    "weights": [file.name for file in weights],
    "again": client.download("datasets", dataset["id"], sys.argv[2]) == files,
    "samples": len(client.trajectory(dataset["id"], 0)["columns"]["q1"]),
    "losses": [point["value"] for point in client.metric(training["run"], "train/loss")],
    "needs": needs,
    "torch": "torch" in sys.modules,
    "version": torqued.__version__,
    "program": torqued.find_binary(),
}))
"""


def package(extension):
    (found,) = REPOSITORY.joinpath("dist").glob(f"*.{extension}")
    return found


def told(*command, **options):
    done = subprocess.run(command, capture_output=True, text=True, **options)
    assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
    return done.stdout.strip()


class Wheel(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="torqued-wheel-")
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)
        cls.environment = cls.folder / "environment"
        told(sys.executable, "-m", "venv", str(cls.environment))
        cls.python = str(cls.environment / "bin/python")
        pip = (cls.python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check")
        told(*pip, "--no-index", str(package("whl")))
        cls.program = cls.environment / "bin/torqued"

    def test_the_program_and_the_module_are_one_version(self):
        version = told(str(self.program), "--version")
        self.assertEqual(told(self.python, "-m", "torqued", "--version"), version)
        self.assertEqual(version, f"torqued {package('whl').name.split('-')[1]}")

    def test_a_notebook_submits_waits_and_downloads_with_nothing_else_installed(self):
        self.addCleanup(setattr, product, "TORQUED", product.TORQUED)
        product.TORQUED = str(self.program)
        server = Server()
        self.addCleanup(server.stop)
        data, weights = self.folder / "data", self.folder / "weights"
        notebook = (self.python, "-c", NOTEBOOK, json.dumps(SPEC), str(data), str(weights))
        found = json.loads(told(*notebook, env={**os.environ, "TORQUED_SERVER": server.url}))
        self.assertIn("trajectories is 0, allowed:", found["refused"])
        self.assertIn("dataset.json", found["files"])
        self.assertTrue(found["again"])
        self.assertEqual(found["samples"], 400)
        self.assertGreater(len(found["losses"]), 0)
        self.assertEqual(
            sorted(found["weights"]),
            ["config.json", "model.safetensors", "optimizer.safetensors", "training.json"],
        )
        self.assertIn("pip install 'torqued[pytorch]'", found["needs"])
        self.assertFalse(found["torch"])
        self.assertEqual(found["program"], str(self.program))
        self.assertEqual(f"torqued {found['version']}", told(str(self.program), "--version"))

    def test_manual_completions_and_licences_are_where_programs_look(self):
        share = self.environment / "share"
        self.assertIn(".TH torqued 1", share.joinpath("man/man1/torqued.1").read_text())
        self.assertTrue(share.joinpath("man/man1/torqued-serve.1").is_file())
        completions = share / "bash-completion/completions/torqued"
        asked = told("bash", "-c", f"source '{completions}'; complete -p torqued")
        self.assertIn("torqued", asked)
        self.assertIn(
            "#compdef torqued", share.joinpath("zsh/site-functions/_torqued").read_text()
        )
        fish = share / "fish/vendor_completions.d/torqued.fish"
        self.assertIn("complete -c torqued", fish.read_text())
        self.assertIn("\nserde 1.", share.joinpath("doc/torqued/third-party.txt").read_text())

    @unittest.skipUnless(shutil.which(BASELINE[0]), f"{BASELINE[0]} is not installed")
    def test_a_processor_without_vector_extensions_makes_a_whole_dataset(self):
        spec = self.folder / "spec.json"
        spec.write_text(json.dumps({"preset": "D1-chirp", "trajectories": 4}))
        data = self.folder / "baseline"
        simulate = ("simulate", "--spec", str(spec), "--out", str(data))
        told(*BASELINE, str(self.program), *simulate)
        self.assertTrue(data.joinpath("dataset.json").is_file())


class Deb(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="torqued-deb-")
        cls.addClassCleanup(folder.cleanup)
        cls.root = pathlib.Path(folder.name) / "root"
        cls.control = pathlib.Path(folder.name) / "control"
        told("dpkg-deb", "--extract", str(package("deb")), str(cls.root))
        told("dpkg-deb", "--control", str(package("deb")), str(cls.control))

    def test_the_program_runs_and_has_the_version_of_the_package(self):
        version = told("dpkg-deb", "--field", str(package("deb")), "Version")
        program = told(str(self.root / "usr/bin/torqued"), "--version")
        self.assertEqual(program, f"torqued {version.rsplit('-', 1)[0]}")

    def test_what_the_program_is_linked_with_is_asked_for(self):
        needed = told("ldd", str(self.root / "usr/bin/torqued"))
        libraries = set(re.findall(r"(\S+)\.so\S* =>", needed))
        self.assertLessEqual(libraries, {"libc", "libgcc_s", "libm"})
        depends = told("dpkg-deb", "--field", str(package("deb")), "Depends")
        for name in ("libc6", "libgcc-s1", "adduser"):
            self.assertIn(name, depends)

    def test_everything_is_where_debian_looks_for_it(self):
        share = self.root / "usr/share"
        page = gzip.decompress(share.joinpath("man/man1/torqued.1.gz").read_bytes()).decode()
        self.assertIn(".TH torqued 1", page)
        for path in (
            "bash-completion/completions/torqued",
            "zsh/vendor-completions/_torqued",
            "fish/vendor_completions.d/torqued.fish",
            "doc/torqued/copyright",
            "doc/torqued/third-party.txt",
        ):
            self.assertGreater(share.joinpath(path).stat().st_size, 0, path)
        for unit in ("torqued.service", "torqued-worker@.service"):
            text = self.root.joinpath("usr/lib/systemd/system", unit).read_text()
            self.assertIn("ExecStart=torqued ", text)
        environment = self.root / "etc/torqued/server.env"
        self.assertEqual(environment.stat().st_mode & 0o777, 0o600)
        self.assertEqual(self.control.joinpath("conffiles").read_text(), "/etc/torqued/server.env\n")

    def test_the_scripts_of_the_package_are_shell(self):
        for script in ("postinst", "prerm", "postrm"):
            path = self.control / script
            told("sh", "-n", str(path))
            self.assertNotIn("#DEBHELPER#", path.read_text())


if __name__ == "__main__":
    unittest.main()

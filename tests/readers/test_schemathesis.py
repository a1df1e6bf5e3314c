"""Valid and invalid requests that schemathesis makes from the OpenAPI document. None breaks the server, and each
response agrees with the document.

CASES=300 sets the number of random requests for each operation, in addition to those that cover every bound."""

import os
import re
import subprocess
import sys
import tempfile
import unittest

from product import Product

CASES = os.environ.get("CASES", "15")

# A token must exist. Otherwise the first one that a case creates would close the server to all
# others.
TOKEN = "a token for this test"

CHECKS = (
    "not_a_server_error,status_code_conformance,content_type_conformance,"
    "response_headers_conformance,response_schema_conformance"
)

# After its handshake, a stream is not HTTP. Events end when their job ends, or never.
STREAMS = [
    "GET /v1/checkpoints/{id}/stream",
    "GET /v1/events",
    "GET /v1/jobs/{id}/events",
    "GET /v1/runs/{id}/events",
]

# All combinations of bounds of a pipeline's jobs would take too long. Random ones do not.
SUBMISSION = "POST /v1/jobs"


class Schemathesis(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.product = Product()
        cls.addClassCleanup(cls.product.stop)
        # Submitted jobs of a case are queued and never run.
        cls.product.restart(
            *("--workers", "0", "--log", "error", "--token", TOKEN, "--max-requests-per-second", "1000000")
        )

    def test_every_bound_of_every_parameter(self):
        cases = self.run_phase("coverage", "--exclude-name", SUBMISSION)
        self.assertGreater(cases, 2000)

    def test_random_requests(self):
        cases = self.run_phase("fuzzing", "--max-examples", CASES)
        self.assertGreater(cases, 15 * int(CASES))

    def test_requests_that_follow_from_answers(self):
        cases = self.run_phase("stateful", "--max-examples", CASES, "--exclude-name", SUBMISSION)
        self.assertGreater(cases, 20)

    def run_phase(self, phase, *options):
        """Runs a phase, and returns its number of cases."""
        with tempfile.TemporaryDirectory(prefix="torqued-schemathesis-") as folder:
            command = [
                *(sys.executable, "-m", "schemathesis.cli", "run", f"{self.product.url}/v1/openapi.json"),
                *("--header", f"Authorization: Bearer {TOKEN}", "--checks", CHECKS),
                *("--phases", phase, *options),
                *(word for stream in STREAMS for word in ("--exclude-name", stream)),
                *("--continue-on-failure", "--suppress-health-check", "all", "--no-color"),
                *("--generation-database", "none", "--request-timeout", "60"),
            ]
            ended = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        self.assertEqual(ended.returncode, 0, ended.stdout + ended.stderr)
        self.assertIsNone(self.product.process.poll(), "the server ended")
        cases = int(re.search(r"(\d+) generated", ended.stdout)[1])
        print(f"{phase}: {cases} cases", file=sys.stderr)
        return cases


if __name__ == "__main__":
    unittest.main()

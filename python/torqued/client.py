"""A client of torqued's HTTP API that needs only Python."""

import hashlib
import http.client
import json
import os
import pathlib
import socket
import time
import urllib.parse
import uuid

DEFAULT_SERVER = "http://127.0.0.1:7070"
FINAL_STATES = ("succeeded", "failed", "cancelled")
_CHUNK_BYTES = 1 << 20
# The field with the files of each kind of thing.
_FILES = {"datasets": "files", "checkpoints": "files", "runs": "artifacts", "evaluations": "artifacts"}


class ServerError(Exception):
    """A refusal of the server. `status` is the HTTP status. `problem` is the answer (RFC 9457), if it is one."""

    def __init__(self, status, problem, advice=None):
        self.status = status
        self.problem = problem
        lines = [problem.get("detail", f"status {status}")]
        if problem.get("violations"):
            # The detail has all violations in one line.
            lines = [problem.get("title", f"status {status}"), *map(_violation, problem["violations"])]
        if problem.get("more_violations"):
            lines.append(f"and {problem['more_violations']} more")
        if advice:
            lines.append(advice)
        super().__init__("\n".join(lines))


class JobEnded(Exception):
    """A job failed or was cancelled while the client waited for it. `job` is its last state."""

    def __init__(self, job):
        self.job = job
        reason = f": {job['error']}" if job.get("error") else ""
        super().__init__(f"job {job['id']} is {job['state']}{reason}")


class Client:
    """A client of one server. `server` is HOST:PORT, http://, https:// or unix:PATH.

    Values that are left out come from TORQUED_SERVER and TORQUED_TOKEN, like those of the command line. Answers are
    those of the API (/v1/openapi.json), as dicts and lists.
    """

    def __init__(self, server=None, token=None, timeout_s=60.0):
        server = server or os.environ.get("TORQUED_SERVER") or DEFAULT_SERVER
        self.server = server.rstrip("/")
        self.timeout_s = timeout_s
        self._token = token or os.environ.get("TORQUED_TOKEN") or None
        self._base = ""
        if not self.server.startswith("unix:"):
            if "://" not in self.server:
                self.server = f"http://{self.server}"
            parts = urllib.parse.urlsplit(self.server)
            if parts.scheme not in ("http", "https") or not parts.hostname:
                raise ValueError(f"server {server!r}, allowed: HOST:PORT, http://, https:// or unix:PATH")
            self._base = parts.path

    def get(self, path, **parameters):
        """The answer to GET, such as `get("/v1/jobs", state="running")`."""
        return self._json("GET", path, parameters)

    def post(self, path, body=None, **parameters):
        """The answer to POST with `body` as JSON."""
        return self._json("POST", path, parameters, body)

    def submit(self, spec, force=False, *, name=None, note=None, tags=()):
        """Submits a job and returns it. A job that was done before, or that is queued or running, is reused unless
        `force`.

        `name`, `note` (Markdown) and `tags` label the job. They do not belong to its spec.
        """
        tags = [tags] if isinstance(tags, str) else list(tags)
        labels = {"name": name, "note": note, "tag": tags or None}
        labels = {label: value for label, value in labels.items() if value is not None}
        return self.post("/v1/jobs", spec, force=json.dumps(force), **labels)

    def wait(self, job, every_s=0.5, timeout_s=None):
        """Waits until `job`, an id or a result of `submit`, has succeeded, and returns it.

        Raises JobEnded if it fails or is cancelled, and TimeoutError if it takes longer than `timeout_s`.
        """
        job_id = job["id"] if isinstance(job, dict) else job
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        while True:
            job = self.get(f"/v1/jobs/{job_id}")
            if job["state"] == "succeeded":
                return job
            if job["state"] in FINAL_STATES:
                raise JobEnded(job)
            if deadline is not None and time.monotonic() > deadline:
                raise TimeoutError(f"job {job_id} is {job['state']} after {timeout_s} s")
            time.sleep(every_s)

    def cancel(self, job):
        return self.post(f"/v1/jobs/{job}/cancel")

    def job(self, job):
        return self.get(f"/v1/jobs/{job}")

    def dataset(self, dataset):
        return self.get(f"/v1/datasets/{dataset}")

    def run(self, run):
        return self.get(f"/v1/runs/{run}")

    def checkpoint(self, checkpoint):
        return self.get(f"/v1/checkpoints/{checkpoint}")

    def evaluation(self, evaluation):
        return self.get(f"/v1/evaluations/{evaluation}")

    def robot(self, robot):
        return self.get(f"/v1/robots/{robot}")

    def add_robot(self, arm, **options):
        """Keeps a robot on the server and returns it. `arm` is the text of a URDF, or a description as a dict.

        `name` is its name in lists. For a URDF there are also `base`, `tip`, `lock` (a dict of positions by joint),
        `mount` (six numbers) and `nearest_physical`. A spec names it: `"robot": {"model": {"robot": id}}`.
        """
        options = {
            name: json.dumps(value) if isinstance(value, bool) else value
            for name, value in options.items()
            if value is not None
        }
        if "lock" in options:
            options["lock"] = [f"{joint}={at}" for joint, at in options["lock"].items()]
        if "mount" in options:
            options["mount"] = ",".join(str(number) for number in options["mount"])
        if isinstance(arm, dict):
            return self._json("POST", "/v1/robots", options, arm)
        return self._json("POST", "/v1/robots", options, arm.encode(), "application/xml")

    def import_recordings(self, *files, mapping, force=False):
        """Imports files of recordings as a dataset and returns the job. `files` are paths, and the dict `mapping` says
        what their columns hold (docs/import.md).

        Several files of the same columns become one dataset. Its recordings are called as the files are, without
        their endings, so that no two may have the same name. A file whose name does not end with its format needs
        `format` in the mapping. An import that was done before is reused unless `force`.
        """
        if not files:
            raise ValueError("no files, allowed: one or more paths")
        boundary = uuid.uuid4().hex
        begin = f"--{boundary}\r\nContent-Disposition: form-data; name="
        parts = [f'{begin}"spec"\r\n\r\n{json.dumps(mapping)}\r\n'.encode()]
        for path in map(pathlib.Path, files):
            name = path.name.replace("\\", "\\\\").replace('"', '\\"')
            parts += [f'{begin}"file"; filename="{name}"\r\n\r\n'.encode(), path, b"\r\n"]
        parts.append(f"--{boundary}--\r\n".encode())
        length = sum(len(it) if isinstance(it, bytes) else it.stat().st_size for it in parts)
        path = f"/v1/datasets?force={json.dumps(force)}"
        media_type = f"multipart/form-data; boundary={boundary}"
        with self._answer("POST", path, _pieces(parts), media_type, length) as answer:
            return json.load(answer)

    def metric(self, run, key, points=None):
        """The points of a metric: dicts with `step`, `time` and `value`, at most `points` of them."""
        parameters = {} if points is None else {"points": points}
        key = urllib.parse.quote(key, safe="")
        return self.get(f"/v1/runs/{run}/metrics/{key}", **parameters)["points"]

    def trajectory(self, dataset, index):
        """A trajectory: `time_s`, and `columns` such as `u1` (N·m) and `q1` (rad) with a value per sample."""
        return self.get(f"/v1/datasets/{dataset}/trajectories/{index}")

    def predict(self, checkpoint, scenarios, **options):
        """Predictions of a checkpoint for scenarios with `u`, `y` and `future_u`, each `[time][joint]`.

        A scenario may have `futures`, a list of such `future_u`, and then has an answer for each. Options are
        `sampling`, `position_noise_rad` and `rate_hz` (docs/prediction.md)."""
        body = {"scenarios": scenarios, **options}
        return self.post(f"/v1/checkpoints/{checkpoint}/predict", body)

    def torque(self, checkpoint, scenarios, **options):
        """The torques of motions, said by a checkpoint with equations of motion. Scenarios have `u` and `y`, each
        `[time][joint]`, and `motion`, a dict of `q`, `qd` and `qdd`, each `[instant][joint]`.

        With `fit`, that of an earlier answer, they have no `u` and `y`, and nothing is fitted. Further options are
        `position_noise_rad` and `rate_hz` (docs/prediction.md)."""
        body = {"scenarios": scenarios, **options}
        return self.post(f"/v1/checkpoints/{checkpoint}/torque", body)

    def download(self, kind, item, folder):
        """Downloads all files of a dataset, a checkpoint, a run or an evaluation into `folder` and returns their
        paths.

        `kind` is "dataset", "checkpoint", "run" or "evaluation", or its plural. Files that exist with the right
        SHA-256 are kept. Raises ValueError if bytes have another SHA-256 than the server's list.
        """
        plural = kind if kind in _FILES else f"{kind}s"
        if plural not in _FILES:
            allowed = ", ".join(repr(known.removesuffix("s")) for known in _FILES)
            raise ValueError(f"kind {kind!r}, allowed: {allowed}")
        files = self.get(f"/v1/{plural}/{item}")[_FILES[plural]]
        folder = pathlib.Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        return [self._fetch(file, folder) for file in files]

    def _fetch(self, file, folder):
        if pathlib.PurePath(file["name"]).name != file["name"]:
            raise ValueError(f"file {file['name']!r}, allowed: a name without folders")
        path = folder / file["name"]
        if path.is_file() and _sha256(path) == file["sha256"]:
            return path
        part = folder / f"{file['name']}.part"
        digest = hashlib.sha256()
        with part.open("wb") as output, self._answer("GET", file["url"]) as answer:
            while chunk := answer.read(_CHUNK_BYTES):
                digest.update(chunk)
                output.write(chunk)
        if digest.hexdigest() != file["sha256"]:
            part.unlink()
            raise ValueError(
                f"checksum mismatch of {file['name']}: expected {file['sha256']}, "
                f"received {digest.hexdigest()}"
            )
        return part.replace(path)

    def _json(self, method, path, parameters, body=None, media_type="application/json"):
        if parameters:
            path = f"{path}?{urllib.parse.urlencode(parameters, doseq=True)}"
        with self._answer(method, path, body, media_type) as answer:
            return json.load(answer)

    def _answer(self, method, path, body=None, media_type="application/json", length=None):
        """The answer to a request. It has a connection of its own, which closes with it. Bytes are sent as they are,
        pieces of `length` bytes together one after the other, and any other body as JSON."""
        headers = {"accept": "application/json, */*;q=0.5", "connection": "close"}
        if self._token:
            headers["authorization"] = f"Bearer {self._token}"
        if body is not None:
            headers["content-type"] = media_type
            if length is not None:
                headers["content-length"] = str(length)
            elif not isinstance(body, bytes):
                body = json.dumps(body).encode()
        connection = self._connection()
        try:
            try:
                connection.request(method, self._base + path, body, headers)
            except (BrokenPipeError, ConnectionResetError):
                # A server that refuses a body answers before its end.
                pass
            answer = connection.getresponse()
        except OSError as reason:
            connection.close()
            message = f"no answer from {self.server}: {reason}; is `torqued serve` running there?"
            raise ConnectionError(message) from reason
        if answer.status >= 400:
            needs_token = answer.status == 401 and not self._token
            advice = "set TORQUED_TOKEN, or pass token to Client" if needs_token else None
            with answer:
                raise ServerError(answer.status, _problem(answer), advice)
        return answer

    def _connection(self):
        if self.server.startswith("unix:"):
            return _SocketConnection(self.server.removeprefix("unix:"), self.timeout_s)
        parts = urllib.parse.urlsplit(self.server)
        https = parts.scheme == "https"
        kind = http.client.HTTPSConnection if https else http.client.HTTPConnection
        return kind(parts.hostname, parts.port, timeout=self.timeout_s)


class _SocketConnection(http.client.HTTPConnection):
    """HTTP over a Unix socket."""

    def __init__(self, path, timeout_s):
        super().__init__("localhost", timeout=timeout_s)
        self._path = path

    def connect(self):
        self.sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.sock.settimeout(self.timeout)
        self.sock.connect(self._path)


def _violation(violation):
    """A violation in one line, as the command line prints it."""
    field = violation["field"] or "the spec"
    if not violation["value"]:
        return f"{field}: {violation['allowed']}"
    return f"{field} is {violation['value']}, allowed: {violation['allowed']}"


def _problem(answer):
    text = answer.read().decode(errors="replace")
    try:
        problem = json.loads(text)
    except ValueError:
        problem = None
    return problem if isinstance(problem, dict) else {"detail": text.strip() or answer.reason}


def _pieces(parts):
    """Bytes as they are, and the contents of files."""
    for part in parts:
        if isinstance(part, bytes):
            yield part
            continue
        with part.open("rb") as file:
            while chunk := file.read(_CHUNK_BYTES):
                yield chunk


def _sha256(path):
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK_BYTES):
            digest.update(chunk)
    return digest.hexdigest()

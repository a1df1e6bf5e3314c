"""torqued in a notebook: jobs and data of its server, its checkpoints in PyTorch, and its program.

    import torqued

    client = torqued.Client("http://127.0.0.1:7070")
    job = client.wait(client.submit({"preset": "D1-chirp", "trajectories": 64}))
    client.download("datasets", job["dataset"], "robots")

    model = torqued.load("checkpoint/")          # model.safetensors and config.json
    y = model.predict(u, y_context)              # [batch, horizon, joint], rad
    model.network                                # a torch.nn.Module
    torqued.save(model, "checkpoint/")           # for `load`

    torqued.find_binary()                        # the program, as `python -m torqued` runs it

`load` and `save` need PyTorch (`pip install 'torqued[pytorch]'`). Everything else needs only Python.
"""

import importlib
import importlib.metadata

from .client import Client, JobEnded, ServerError
from .program import find_binary

# These are imported on first use. PyTorch takes seconds and need not be installed.
_OF_CHECKPOINTS = ("FORMAT_VERSION", "TrainedModel", "load", "save")

__all__ = ["Client", "JobEnded", "ServerError", "find_binary", *_OF_CHECKPOINTS]


def __getattr__(name):
    if name == "__version__":
        return importlib.metadata.version("torqued")
    if name in _OF_CHECKPOINTS:
        try:
            return getattr(importlib.import_module(".checkpoint", __name__), name)
        except ModuleNotFoundError as missing:
            message = f"torqued.{name} needs {missing.name}: pip install 'torqued[pytorch]'"
            raise ImportError(message) from missing
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__():
    return sorted([*globals(), *_OF_CHECKPOINTS, "__version__"])

"""Read torqued's checkpoints in PyTorch.

    import torqued
    model = torqued.load("checkpoint/")          # model.safetensors and config.json
    y = model.predict(u, y_context)              # [batch, horizon, 7], rad
    model.network                                # a torch.nn.Module
"""

from .checkpoint import FORMAT_VERSION, TrainedModel, load
from .robomorph import RoboMorph

__all__ = ["FORMAT_VERSION", "RoboMorph", "TrainedModel", "load"]

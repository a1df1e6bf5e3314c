"""Read torqued's checkpoints in PyTorch.

    import torqued
    model = torqued.load("checkpoint/")          # model.safetensors and config.json
    y = model.predict(u, y_context)              # [batch, horizon, 7], rad
    model.network                                # a torch.nn.Module
"""

from .cdcnn import Cdcnn
from .cdt import Cdt
from .checkpoint import FORMAT_VERSION, TrainedModel, load
from .diffuser import Diffuser
from .robomorph import RoboMorph

__all__ = ["FORMAT_VERSION", "Cdcnn", "Cdt", "Diffuser", "RoboMorph", "TrainedModel", "load"]

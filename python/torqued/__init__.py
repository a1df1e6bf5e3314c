"""Read torqued's checkpoints in PyTorch, and write them.

    import torqued
    model = torqued.load("checkpoint/")          # model.safetensors and config.json
    y = model.predict(u, y_context)              # [batch, horizon, joint], rad
    model.network                                # a torch.nn.Module
    torqued.save(model, "checkpoint/")           # for torqued to predict with
"""

from .cdcnn import Cdcnn
from .cdt import Cdt
from .checkpoint import FORMAT_VERSION, TrainedModel, load, save
from .diffuser import Diffuser
from .flow import Flow
from .robomorph import RoboMorph

__all__ = ["FORMAT_VERSION", "Cdcnn", "Cdt", "Diffuser", "Flow", "RoboMorph", "TrainedModel", "load", "save"]

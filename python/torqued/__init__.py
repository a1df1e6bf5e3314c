"""Read torqued's checkpoints in PyTorch, and write them.

    import torqued
    model = torqued.load("checkpoint/")          # model.safetensors and config.json
    y = model.predict(u, y_context)              # [batch, horizon, joint], rad
    model.network                                # a torch.nn.Module
    torqued.save(model, "checkpoint/")           # for torqued to predict with
"""

from .checkpoint import FORMAT_VERSION, TrainedModel, load, save

__all__ = ["FORMAT_VERSION", "TrainedModel", "load", "save"]

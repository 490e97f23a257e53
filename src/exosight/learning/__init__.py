"""Learning: networks that estimate sensors from an image, their training, checkpoints and ONNX files.

PyTorch is needed for the names below that train or export, and is imported only when one of them is used.
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

from exosight.errors import InputError
from exosight.learning.config import TrainConfig
from exosight.learning.history import EpochRecord, read_history
from exosight.learning.training_data import FrameBlock, TrainingData

if TYPE_CHECKING:
    from exosight.learning.checkpoint import load_model
    from exosight.learning.export import export_onnx
    from exosight.learning.pretrained import Pretrained, load_pretrained
    from exosight.learning.training import Progress, TrainResult, train

# Set before PyTorch is loaded: its OpenMP threads otherwise spin while they wait for each other, which beside
# other work made a training step on two threads several times slower than on one.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

__all__ = [
    "EpochRecord",
    "FrameBlock",
    "Pretrained",
    "Progress",
    "TrainConfig",
    "TrainResult",
    "TrainingData",
    "export_onnx",
    "load_model",
    "load_pretrained",
    "read_history",
    "train",
]

_NEEDS_TORCH = {
    "Progress": "training",
    "Pretrained": "pretrained",
    "TrainResult": "training",
    "export_onnx": "export",
    "load_model": "checkpoint",
    "load_pretrained": "pretrained",
    "train": "training",
}


def __getattr__(name: str) -> Any:
    if name not in _NEEDS_TORCH:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        return getattr(import_module(f"{__name__}.{_NEEDS_TORCH[name]}"), name)
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("exosight"):
            raise
        raise InputError(
            f"{name} needs {error.name}, which is not installed: pip install 'exosight[train]'"
        ) from error

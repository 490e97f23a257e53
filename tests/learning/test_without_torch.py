import subprocess
import sys

import pytest

import exosight.learning

BLOCKED = """
import sys
for name in ("torch", "onnxscript", "safetensors"):
    sys.modules[name] = None
import exosight.learning
from exosight.control.estimator import DEFAULT_MODEL, OnnxEstimator
from exosight.errors import InputError
from exosight.learning import TrainConfig, read_history
TrainConfig(network="paper")
OnnxEstimator.load(DEFAULT_MODEL)
for name in ("train", "export_onnx", "load_model"):
    try:
        getattr(exosight.learning, name)
    except InputError as error:
        print(error)
"""


def test_everything_but_training_works_without_pytorch():
    done = subprocess.run([sys.executable, "-c", BLOCKED], capture_output=True, text=True, check=True)
    lines = done.stdout.splitlines()
    assert len(lines) == 3
    assert lines[0] == "train needs torch, which is not installed: pip install 'exosight[train]'"
    assert all("exosight[train]" in line for line in lines)


def test_pytorch_is_not_loaded_before_it_is_used():
    code = "import sys, exosight.learning, exosight.control.estimator; print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_every_public_name_is_there_and_an_unknown_one_is_not():
    for name in exosight.learning.__all__:
        assert getattr(exosight.learning, name).__name__ == name
    with pytest.raises(AttributeError, match="no attribute 'trian'"):
        exosight.learning.__getattr__("trian")

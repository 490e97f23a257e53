"""`exosight train` as torchrun starts it: two processes, one network."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import torch.distributed as dist

from exosight.app.pipeline import MODEL
from exosight.learning.board import BOARD_NAME
from exosight.learning.checkpoint import CHECKPOINT_NAME, load_checkpoint
from exosight.learning.history import HISTORY_NAME


@pytest.mark.skipif(not dist.is_available() or not dist.is_gloo_available(), reason="needs PyTorch with gloo")
def test_torchrun_trains_one_network(data: Path, tmp_path: Path) -> None:
    program = shutil.which("exosight", path=Path(sys.executable).parent)
    if program is None:
        pytest.skip("needs exosight beside its Python, as pip installs it")
    out = tmp_path / "run"
    out.mkdir()
    (out / MODEL).write_text("exported already, which saves the time")
    launcher = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    command = [program, "train", "--data", str(data), "--out", str(out), "--resume", "--epochs", "1"]
    words = [*launcher, "--no-python", *command, "--device", "cpu"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("best epoch 1 of 1") == done.stderr.count("wrote ") == 1
    assert {path.name for path in out.iterdir()} == {CHECKPOINT_NAME, HISTORY_NAME, MODEL, BOARD_NAME}
    assert load_checkpoint(out).position.complete

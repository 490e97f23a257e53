import json
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from schemas import published_schema

from exosight.errors import DataError
from exosight.learning.checkpoint import (
    CHECKPOINT_NAME,
    Checkpoint,
    load_checkpoint,
    load_model,
    save_checkpoint,
)
from exosight.learning.networks import build_network

# The files of all examples may share one folder: each example writes its own whole file first.
with_files = settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def write(folder: Path, checkpoint: Checkpoint) -> Path:
    folder.mkdir(exist_ok=True)
    save_checkpoint(folder, checkpoint.run, checkpoint.position, checkpoint.history, checkpoint.tensors)
    return folder


def test_a_checkpoint_reads_back_whole(trained: Path, tmp_path: Path):
    first = load_checkpoint(trained)
    second = load_checkpoint(write(tmp_path, first))
    assert (second.run, second.position, second.history) == (first.run, first.position, first.history)
    assert second.run.data_identity == {"camera": "512 px/m", "shapes": 3, "young": 300e3}
    assert all(torch.equal(tensor, second.tensors[name]) for name, tensor in first.tensors.items())


@with_files
@given(share=st.floats(0, 1, exclude_max=True))
def test_a_truncated_checkpoint_is_a_data_error(trained: Path, tmp_path: Path, share: float):
    data = (trained / CHECKPOINT_NAME).read_bytes()
    path = tmp_path / "part.safetensors"
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(DataError, match=str(path)):
        load_checkpoint(path)


@with_files
@given(share=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7), in_header=st.booleans())
def test_one_flipped_bit_is_a_data_error(
    trained: Path, tmp_path: Path, share: float, bit: int, in_header: bool
):
    data = bytearray((trained / CHECKPOINT_NAME).read_bytes())
    end = 8 + int.from_bytes(data[:8], "little") if in_header else len(data)
    data[int(share * end)] ^= 1 << bit
    path = tmp_path / "flipped.safetensors"
    path.write_bytes(data)
    with pytest.raises(DataError):
        load_checkpoint(path)


@with_files
@given(data=st.binary(max_size=400))
def test_random_bytes_are_a_data_error(tmp_path: Path, data: bytes):
    path = tmp_path / "random.safetensors"
    path.write_bytes(data)
    with pytest.raises(DataError):
        load_checkpoint(path)


@pytest.mark.parametrize(
    "content",
    [
        pickle.dumps({"network": 1}),
        (2).to_bytes(8, "little") + b"{}",
        (1 << 60).to_bytes(8, "little") + b"{}",
        (19).to_bytes(8, "little") + b'{"__metadata__":{}}',
    ],
)
def test_other_files_are_a_data_error(tmp_path: Path, content: bytes):
    path = tmp_path / "other.safetensors"
    path.write_bytes(content)
    with pytest.raises(DataError, match="not a checkpoint of exosight"):
        load_checkpoint(path)


@pytest.mark.parametrize("name", ["missing", "missing.safetensors", "."])
def test_a_missing_checkpoint_is_a_data_error(tmp_path: Path, name: str):
    with pytest.raises(DataError, match="cannot be read"):
        load_checkpoint(tmp_path / name)


def other_network(checkpoint: Checkpoint) -> Checkpoint:
    return replace(
        checkpoint,
        run=replace(
            checkpoint.run,
            settings=replace(checkpoint.run.settings, network="paper"),
            schema=published_schema(128, 128),
        ),
    )


def with_settings(checkpoint: Checkpoint, **changes: int) -> Checkpoint:
    return replace(
        checkpoint, run=replace(checkpoint.run, settings=replace(checkpoint.run.settings, **changes))
    )


def other_tensor(checkpoint: Checkpoint, **change: torch.Tensor) -> Checkpoint:
    return replace(checkpoint, tensors={**checkpoint.tensors, **change})


LIES: dict[str, tuple[Callable[[Checkpoint], Checkpoint], str]] = {
    "another network": (other_network, "only one of the paper network and the file"),
    "a network that cannot take the image": (
        lambda c: replace(c, run=replace(other_network(c).run, schema=published_schema(32, 32))),
        "128×128",
    ),
    "another image size": (
        lambda c: replace(c, run=replace(c.run, schema=published_schema(80, 80))),
        "in the file",
    ),
    "an image larger than memory": (
        lambda c: replace(c, run=replace(c.run, schema=published_schema(10**9, 10**9))),
        "4096 pixels",
    ),
    "a scale of zero": (lambda c: replace(c, run=replace(c.run, output_scale=(0.0,) * 7)), "output_scale"),
    "six outputs": (lambda c: replace(c, run=replace(c.run, output_scale=(1.0,) * 6)), "output_scale"),
    "an epoch that is not in the history": (
        lambda c: replace(c, position=replace(c.position, epoch=9)),
        "9 epochs done, but 6 in the history",
    ),
    "a best epoch that never was": (
        lambda c: replace(c, position=replace(c.position, best_epoch=99)),
        "best_epoch=99",
    ),
    "a negative step": (
        lambda c: replace(c, position=replace(c.position, step=-1)),
        "position.step: .* '-1'",
    ),
    "more steps than there are": (
        lambda c: replace(c, position=replace(c.position, step=2**70)),
        "position.step",
    ),
    "a seed without end": (lambda c: with_settings(c, seed=2**70), "run.settings.seed"),
    "batches of nothing": (lambda c: with_settings(c, batch=0), "run.settings.batch"),
    "999 earlier images": (lambda c: with_settings(c, history=999), "run.settings.history"),
    "a scale that single precision does not hold": (
        lambda c: replace(c, run=replace(c.run, output_scale=(1e300,) * 7)),
        "output_scale",
    ),
    "a missing tensor": (
        lambda c: replace(c, tensors={k: v for k, v in c.tensors.items() if k != "best.2.0.weight"}),
        "best.2.0.weight is in only one",
    ),
    "a tensor too many": (lambda c: other_tensor(c, extra=torch.zeros(1)), "extra is in only one"),
    "a tensor of another type": (
        lambda c: other_tensor(c, **{"network.2.0.weight": c.tensors["network.2.0.weight"].double()}),
        "network.2.0.weight is torch.float64",
    ),
    "a tensor with NaN": (
        lambda c: other_tensor(c, **{"network.2.0.weight": c.tensors["network.2.0.weight"] * torch.nan}),
        "network.2.0.weight is not finite",
    ),
}


@pytest.mark.parametrize("lie", LIES)
def test_a_header_that_does_not_fit_is_a_data_error(trained: Path, tmp_path: Path, lie: str):
    change, message = LIES[lie]
    with pytest.raises(DataError, match=message):
        load_checkpoint(write(tmp_path, change(load_checkpoint(trained))))


def test_another_format_is_named(trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    checkpoint = load_checkpoint(trained)
    monkeypatch.setattr("exosight.learning.checkpoint._FORMAT", 2)
    write(tmp_path, checkpoint)
    monkeypatch.undo()
    with pytest.raises(DataError, match="checkpoint format 2, this exosight reads format 3; train again"):
        load_checkpoint(tmp_path)


def test_a_header_of_another_version_is_named(trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    checkpoint = load_checkpoint(trained)
    dumps = json.dumps
    with monkeypatch.context() as patch:
        patch.setattr(json, "dumps", lambda *a, **k: dumps(*a, **k).replace('"light"', '"huge"'))
        write(tmp_path, checkpoint)
    with pytest.raises(DataError, match=r"run\.settings\.network"):
        load_checkpoint(tmp_path)


@pytest.mark.parametrize("header", ["[" * 100_000, '{"format": NaN}', '{"format": 1e999}', "9" * 5000, "[3]"])
def test_a_header_that_is_no_header_is_a_data_error(
    trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, header: str
):
    checkpoint = load_checkpoint(trained)
    with monkeypatch.context() as patch:
        patch.setattr(json, "dumps", lambda *a, **k: header)
        write(tmp_path, checkpoint)
    with pytest.raises(DataError, match="not a checkpoint of exosight"):
        load_checkpoint(tmp_path)


def test_a_model_before_the_first_validation_is_refused(trained: Path, tmp_path: Path):
    checkpoint = load_checkpoint(trained)
    early = replace(checkpoint, history=(), position=replace(checkpoint.position, epoch=0, best_epoch=0))
    with pytest.raises(DataError, match="before its first validation"):
        load_model(write(tmp_path, early))


def test_the_model_holds_the_best_weights(trained: Path):
    checkpoint, model = load_checkpoint(trained), load_model(trained)
    fresh = build_network("light", published_schema(40, 40), 2, 5).state_dict()
    for name, tensor in model.network.state_dict().items():
        assert torch.equal(tensor, checkpoint.tensors[f"best.{name}"])
    assert not torch.equal(fresh["2.0.weight"], checkpoint.tensors["best.2.0.weight"])
    assert model.scale.tolist() == pytest.approx(checkpoint.run.output_scale)

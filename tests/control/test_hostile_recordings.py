"""Recordings of unknown origin: nothing outside the file is read, and what no run leaves is refused."""

import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import numpy as np
import pytest

from exosight.app.commands.replay import replay as command
from exosight.control import ControllerConfig, Guarded, Scheduled, State
from exosight.control.guard import Measurement
from exosight.control.realtime import Step
from exosight.control.recording import Recorder, read_recording
from exosight.errors import DataError

SHAPE = (4, 6)


@pytest.fixture
def recording(tmp_path: Path, straight_config: ControllerConfig) -> Path:
    """Twenty steps, with an image in each."""
    path = tmp_path / "run.h5"
    recorder = Recorder(path, SHAPE, Guarded(Scheduled(straight_config)), Path(__file__))
    for i in range(20):
        measurement = Measurement(np.full(SHAPE, i, np.uint8))
        recorder.append(Step(i / 10, 0.2, measurement, None, 0.0, State.NORMAL, "", np.zeros(4), 0.0))
    recorder.close()
    return path


def altered(path: Path, change: Callable[[h5py.File], None]) -> str:
    """The sentence that refuses the file after the change."""
    with h5py.File(path, "a") as file:
        change(file)
    with pytest.raises(DataError) as caught:
        read_recording(path)
    assert str(caught.value).isprintable()
    return str(caught.value)


@pytest.mark.parametrize(
    "name", ["target", "images", "controller", "controller/rate", "controller/loading/u"]
)
def test_links_are_refused_before_they_are_followed(recording: Path, name: str) -> None:
    """Each link would lead to a pipe, which waits for ever when it is opened."""
    pipe = recording.with_name("pipe")
    os.mkfifo(pipe)
    for link in (h5py.ExternalLink(str(pipe), "/x"), h5py.SoftLink("/elsewhere")):

        def lead_outside(file: h5py.File, link: object = link) -> None:
            del file[name]
            file[name] = link

        assert "or a link" in altered(recording, lead_outside)


@pytest.mark.parametrize(
    ("at", "number", "sentence"),
    [
        (24, 2**64 - 16, "without an end"),  # of the first object: with its head, as long as nothing
        (8, 2**22 + 1, "heaps of texts of more than"),  # of the whole heap
    ],
)
def test_texts_that_never_end_are_refused(recording: Path, at: int, number: int, sentence: str) -> None:
    """HDF5 goes from one text of a heap to the next by the length that each has in the file."""
    content = recording.read_bytes() + bytes(2**22)
    heap = content.index(b"GCOL") + at
    recording.write_bytes(content[:heap] + number.to_bytes(8, "little") + content[heap + 8 :])
    with pytest.raises(DataError, match=sentence):
        read_recording(recording)


def test_arrays_outside_of_the_file_are_refused_unopened(recording: Path) -> None:
    pipe = recording.with_name("pipe")
    os.mkfifo(pipe)

    def virtual(file: h5py.File) -> None:
        del file["target"]
        layout = h5py.VirtualLayout((20,), "f8", maxshape=(None,))
        source = h5py.VirtualSource(str(pipe), "x", (20,), maxshape=(None,))
        layout[: h5py.h5s.UNLIMITED] = source[: h5py.h5s.UNLIMITED]
        file.create_virtual_dataset("target", layout)

    def external(file: h5py.File) -> None:
        del file["target"]
        file.create_dataset("target", (20,), "f8", external=[(str(pipe), 0, 160)])

    assert "not an array of this file" in altered(recording, virtual)
    assert "not an array of this file" in altered(recording, external)


def test_a_pipe_and_a_folder_are_no_recordings(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path):
        with pytest.raises(DataError, match="cannot be read"):
            read_recording(path)


def test_claimed_steps_are_held_against_what_is_stored(recording: Path) -> None:
    def claim(file: h5py.File) -> None:
        for name in file:
            if isinstance(file[name], h5py.Dataset):
                file[name].resize(10**6, axis=0)

    assert "claims 1000000 steps, of which the file stores 20" in altered(recording, claim)


def test_claimed_points_of_a_path_are_held_against_what_is_stored(recording: Path) -> None:
    def claim(file: h5py.File) -> None:
        del file["controller/loading/u"]
        file.create_dataset("controller/loading/u", (10**12,), "f8")

    assert "claims 1000000000000 rows, the file stores 0" in altered(recording, claim)


def test_blocks_that_unpack_to_more_than_memory_are_refused(recording: Path) -> None:
    def pack(file: h5py.File) -> None:
        del file["images"]
        file.create_dataset(
            "images", (20, *SHAPE), "u1", chunks=(10**8, *SHAPE), maxshape=(None, *SHAPE), compression=1
        )

    assert "blocks of 2400000000 bytes" in altered(recording, pack)


def put(name: str, value: float, place: int = 3) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        file[name][place] = value

    return change


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        *(
            (name, np.nan, "numbers up to 1e+09")
            for name in ("time", "target", "command", "estimated", "late")
        ),
        *(
            (name, np.inf, "numbers up to 1e+09")
            for name in ("time", "age", "reported", "true", "low", "ood_score")
        ),
        ("command", 1e300, "numbers up to 1e+09"),
        ("time", 0.1, "times do not rise"),
        ("state", 4, "state expects 0…3, got 0…4"),
        ("state", -1, "state expects 0…3"),
        ("missed", -1, "missed expects at least 0"),
        ("controller/loading/outputs", 1e300, "beyond 1e+09"),
        ("controller/loading/u", np.nan, "expected finite numbers"),
    ],
)
def test_what_no_run_leaves_is_refused(recording: Path, name: str, value: float, sentence: str) -> None:
    assert sentence in altered(recording, put(name, value))


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("time", np.zeros((20, 2))),
        ("time", np.zeros(20, "f4")),
        ("time", np.array([b"0.1"] * 20)),
        ("seconds", np.zeros((20, 3))),
        ("images", np.zeros((20, 24), np.uint8)),
        ("images", np.zeros((20, 4, 6), np.int8)),
        ("controller/rate", np.zeros(3)),
        ("controller/period", 5e-324),
        ("controller/output_limits", np.zeros((7, 1))),
        ("controller/unloading/snapped", np.zeros(61)),
    ],
)
def test_other_shapes_and_types_are_refused(recording: Path, name: str, values: np.ndarray | float) -> None:
    def change(file: h5py.File) -> None:
        del file[name]
        file[name] = values

    assert "damaged, or not a recording of exosight" in altered(recording, change)


@pytest.mark.parametrize("name", ["format", "model", "schema", "guard", "adaptive", "sensor"])
@pytest.mark.parametrize("value", ["\x1b[31m", np.zeros(3), "[" * 100_000])
def test_other_texts_are_refused_and_shown_as_text(recording: Path, name: str, value: object) -> None:
    if name == "model" and isinstance(value, str):
        return  # compared with a checksum, never shown

    def change(file: h5py.File) -> None:
        del file.attrs[name]
        file.attrs.create(name, value)

    altered(recording, change)


def test_terminal_escapes_in_causes_are_shown_as_text(
    recording: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from exosight.control import estimator
    from exosight.control.estimator import OnnxEstimator, Reading

    with h5py.File(recording, "a") as file:
        file["cause"][3] = "seen\x1b]0;title\x07…".encode()[:-1]  # cut within a letter

    class Network(OnnxEstimator):
        def __init__(self) -> None:
            object.__setattr__(self, "card", SimpleNamespace(check_fits=lambda *_: None, actuation=False))

        def read(self, images: np.ndarray, *_: Any, **__: Any) -> Reading:
            zeros = np.zeros((1, 7), np.float32)
            return Reading(zeros, zeros, zeros, zeros, np.zeros(1, np.float32))

    network = Network()
    monkeypatch.setattr(estimator.OnnxEstimator, "load", lambda *_, **__: network)
    command(recording)
    shown = capsys.readouterr()
    assert "\x1b" not in shown.out + shown.err
    assert r"seen\x1b]0;title\x07" in shown.err

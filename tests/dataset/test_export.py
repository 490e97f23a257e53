"""Datasets and paths for other programs: what is written reads back as the same numbers."""

import csv
import json
import shutil
import subprocess
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st

from exosight.dataset import QUANTITIES, Frames, read_frames, write_chunk, write_manifest
from exosight.dataset.export import _named, export_dataset, export_path, read_path
from exosight.dataset.matlab import from_matlab, read_mat, to_matlab, write_mat
from exosight.errors import DataError, InputError
from exosight.files import new_file
from exosight.system.schema import SensorSpec

from .conftest import CAMERA, DESIGNS, FAMILIES, SCHEMA, describe, made_up


def some_frames(count: int, seed: int = 0) -> Frames:
    """Random content under valid labels, of the first design."""
    return made_up(DESIGNS[:1], count, seed)


def assert_same(frames: Frames, others: Frames) -> None:
    for name, quantity in QUANTITIES.items():
        mine, theirs = getattr(frames, name), getattr(others, name)
        assert mine.dtype == theirs.dtype == quantity.dtype
        np.testing.assert_array_equal(mine, theirs, err_msg=name)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five frames on disk, of which the light varied."""
    folder = tmp_path_factory.mktemp("data") / "data"
    folder.mkdir()
    chunk = write_chunk(folder, 0, some_frames(5), {"lighting.ambient": np.linspace(0.1, 0.5, 5)})
    manifest = describe([chunk])
    write_manifest(folder, manifest)
    return folder


@given(count=st.integers(1, 4), seed=st.integers(0, 2**16))
@settings(max_examples=10)
def test_frames_return_from_a_mat_file(
    count: int, seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("mat") / "frames.mat"
    frames = some_frames(count, seed)
    write_mat(path, to_matlab(frames))
    assert_same(from_matlab(read_mat(path), SCHEMA), frames)


def test_matlab_shows_frames_upright(dataset: Path, tmp_path: Path) -> None:
    """`images(:, :, k)` is frame k; texts are cells; what varied is a structure; numbers are columns."""
    assert export_dataset(dataset, tmp_path / "data.mat") == 5
    found, frames = scipy.io.loadmat(tmp_path / "data.mat"), read_frames(dataset)
    assert found["images"].shape == (CAMERA.height, CAMERA.width, 5)
    np.testing.assert_array_equal(found["images"][:, :, 3], frames.images[3])
    assert found["step"].shape == (5, 1)
    assert found["commands"].shape == (5, 2)
    assert [str(cell[0][0]) for cell in found["sensor_names"]] == ["P1", "P2", "P3", "F_net", "knuckle"]
    assert [str(cell[0][0]) for cell in found["channel_units"]] == ["N", "kPa"]
    assert [str(cell[0][0]) for cell in found["families"]] == list(FAMILIES)
    np.testing.assert_array_equal(
        found["variation"][0, 0]["lighting_ambient"].ravel(), np.linspace(0.1, 0.5, 5)
    )
    assert json.loads(found["manifest"][0])["camera"]["width"] == CAMERA.width


@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="needs GNU Octave")
def test_octave_reads_a_dataset_and_saves_it_back(dataset: Path, tmp_path: Path) -> None:
    """The commands of docs/matlab.md, by a program with MATLAB's language; its columns begin at 1."""
    export_dataset(dataset, tmp_path / "data.mat")
    script = """
        d = load('data.mat'); about = jsondecode(d.manifest); v = d.variation;
        disp([size(d.images), double(d.images(2, 3, 4)), about.camera.width, v.lighting_ambient(5)]);
        disp(d.families{d.family(1) + 1});
        save('mine.mat', '-struct', 'd', '-v7');
    """
    told = subprocess.run(["octave-cli", "--eval", script], cwd=tmp_path, capture_output=True, text=True)
    assert told.returncode == 0, told.stderr
    frames = read_frames(dataset)
    numbers, family = told.stdout.splitlines()
    expected = [CAMERA.height, CAMERA.width, 5, frames.images[3, 1, 2], CAMERA.width, 0.5]
    assert [float(each) for each in numbers.split()] == pytest.approx(expected, abs=0.01)  # as it prints
    assert family == FAMILIES[frames.family[0]]
    assert_same(from_matlab(read_mat(tmp_path / "mine.mat"), SCHEMA), frames)


def test_what_matlab_saves_as_double_is_taken(tmp_path: Path) -> None:
    frames = some_frames(3)
    scipy.io.savemat(
        tmp_path / "mine.mat",
        {name: np.asarray(values, dtype=float) for name, values in to_matlab(frames).items()},
    )
    assert_same(from_matlab(read_mat(tmp_path / "mine.mat"), SCHEMA), frames)


def test_a_single_frame_loses_its_last_dimension_in_matlab(tmp_path: Path) -> None:
    frames = some_frames(1)
    values = to_matlab(frames)
    values["images"] = values["images"][:, :, 0]
    write_mat(tmp_path / "one.mat", values)
    assert_same(from_matlab(read_mat(tmp_path / "one.mat"), SCHEMA), frames)


@pytest.mark.parametrize(
    ("name", "values", "words"),
    [
        ("sensors", None, "sensors is missing"),
        ("sensors", np.ones((3, 8)), r"sensors expects \(5,\) a frame"),
        ("sensors", np.full((3, 5), np.nan), "not finite"),
        ("step", np.ones((3, 2)), "one number a frame"),
        ("images", np.full((4, 6, 3), 300.0), "whole numbers of uint8"),
        ("images", np.full((4, 6, 3), 0.5), "whole numbers of uint8"),
        ("family", np.array([0, 1, -1]), "family must be within"),
        ("commands", np.full((3, 2), 99.0), "push must lie within"),
        ("pose", np.ones((2, 25)), "as many rows"),
        ("design", np.array(["a", "b", "c"]), "expects numbers"),
    ],
)
def test_unfit_frames_are_refused(name: str, values: np.ndarray | None, words: str) -> None:
    given = to_matlab(some_frames(3))
    if values is None:
        del given[name]
    else:
        given[name] = values
    with pytest.raises(InputError, match=words):
        from_matlab(given, SCHEMA)


def test_npz_holds_the_same_arrays_without_pickles(dataset: Path, tmp_path: Path) -> None:
    export_dataset(dataset, tmp_path / "data.npz")
    frames = read_frames(dataset)
    with np.load(tmp_path / "data.npz", allow_pickle=False) as found:
        for name in QUANTITIES:
            np.testing.assert_array_equal(found[name], getattr(frames, name))
        assert found["families"].tolist() == list(FAMILIES)
        assert found["variation_lighting_ambient"][0] == 0.1


def test_names_of_columns_keep_apart_what_is_per_metre() -> None:
    sensors = (SensorSpec("row_0", "force per length", "N/m"), SensorSpec("knuckle", "joint angle", "rad"))
    assert [*_named("sensor", sensors, np.zeros((1, 2)))] == ["sensor_row_0_N_per_m", "sensor_knuckle_rad"]


def test_tables_and_pictures_hold_every_digit(dataset: Path, tmp_path: Path) -> None:
    shown: list[tuple[int, int]] = []
    (tmp_path / "out").mkdir()
    export_dataset(dataset, tmp_path / "out", lambda done, total: shown.append((done, total)))
    assert shown[-1] == (5, 5)
    frames = read_frames(dataset)
    with (tmp_path / "out" / "frames.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 5
    for k, row in enumerate(rows):
        seen = cv2.imread(str(tmp_path / "out" / row["image"]), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(seen, frames.images[k])
        names = ["P1_N", "P2_N", "P3_N", "F_net_N", "knuckle_rad"]
        assert [np.float32(row[f"sensor_{name}"]) for name in names] == frames.sensors[k].tolist()
        assert np.float32(row["command_push_N"]) == frames.commands[k, 0]
        assert np.float32(row["command_pull_kPa"]) == frames.commands[k, 1]
        assert [float(row[f"q{i}"]) for i in range(25)] == frames.pose[k].tolist()
        assert row["family"] in FAMILIES
    assert [float(row["lighting.ambient"]) for row in rows] == np.linspace(0.1, 0.5, 5).tolist()


@pytest.fixture
def path_file(tmp_path: Path) -> Path:
    """What `exosight simulate --json` writes, in small."""
    records = [
        {"u": 0.1 * i, "converged": i != 1, "iterations": i, "forces": [0.01 * i, 0.2], "F_net": 0.2}
        for i in range(3)
    ]
    path = tmp_path / "path.json"
    path.write_text(json.dumps({"exosuit": {"family": "linear"}, "units": {"u": "N"}, "path": records}))
    return path


def test_a_path_goes_to_all_formats(path_file: Path, tmp_path: Path) -> None:
    for ending in ("mat", "npz", "csv"):
        assert export_path(path_file, tmp_path / f"path.{ending}") == 3
    found = read_mat(tmp_path / "path.mat")
    np.testing.assert_array_equal(found["forces"], [[0.0, 0.2], [0.01, 0.2], [0.02, 0.2]])
    assert found["converged"].ravel().tolist() == [1, 0, 1]
    assert json.loads(found["exosuit"]) == {"family": "linear"}
    with np.load(tmp_path / "path.npz", allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["u"], found["u"].ravel())
    with (tmp_path / "path.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["forces_0"]) for row in rows] == [0.0, 0.01, 0.02]
    assert read_path(path_file)[1]["iterations"].tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    "content",
    ["", "[]", "{}", '{"path": []}', '{"path": [{"u": "x"}], "exosuit": 1, "units": 1}', "[" * 100_000],
)
def test_what_is_no_path_is_refused(content: str, tmp_path: Path) -> None:
    (tmp_path / "path.json").write_text(content)
    with pytest.raises(DataError):
        read_path(tmp_path / "path.json")


def test_damaged_and_foreign_mat_files_are_refused(tmp_path: Path) -> None:
    write_mat(tmp_path / "good.mat", to_matlab(some_frames(2)))
    whole = (tmp_path / "good.mat").read_bytes()
    for name, content in (("cut", whole[: len(whole) // 2]), ("text", b"hello"), ("empty", b"")):
        (tmp_path / f"{name}.mat").write_bytes(content)
        with pytest.raises(DataError):
            read_mat(tmp_path / f"{name}.mat")
    with pytest.raises(DataError, match="cannot be read"):
        read_mat(tmp_path / "none.mat")
    with h5py.File(tmp_path / "new.mat", "w", userblock_size=512) as file:
        file["x"] = 1.0
    header = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    with (tmp_path / "new.mat").open("r+b") as raw:
        raw.write(header)
    with pytest.raises(DataError, match="-v7"):
        read_mat(tmp_path / "new.mat")


def test_nothing_is_overwritten_and_nothing_half_is_left(tmp_path: Path) -> None:
    target = tmp_path / "there.mat"
    target.write_text("mine")
    with pytest.raises(DataError, match="exists already"):
        write_mat(target, {"x": np.ones(2)})
    assert target.read_text() == "mine"
    with pytest.raises(DataError, match="cannot be read"), new_file(tmp_path / "new.mat") as part:
        read_mat(part)  # nothing has been written to it
    assert [path.name for path in tmp_path.iterdir()] == ["there.mat"]


@pytest.mark.parametrize("name", ["a b", "_x", "1x", "x" * 64, "größe"])
def test_names_must_be_matlabs(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no name in MATLAB"):
        write_mat(tmp_path / "x.mat", {name: np.ones(1)})


def test_what_the_format_cannot_hold_is_refused_before_the_work(tmp_path: Path) -> None:
    vast = np.lib.stride_tricks.as_strided(np.zeros(1, np.uint8), (2**31,), (0,))
    with pytest.raises(InputError, match="2 GiB a variable"):
        write_mat(tmp_path / "x.mat", {"x": vast})


def test_other_formats_are_refused(dataset: Path, path_file: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"expected \.mat"):
        export_dataset(dataset, tmp_path / "data.parquet")
    with pytest.raises(InputError, match=r"expected \.mat"):
        export_path(path_file, tmp_path / "path.xlsx")

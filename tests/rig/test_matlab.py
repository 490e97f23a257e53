""".mat files of both kinds, with pictures in all usual orders."""

from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from own_data import imported, pictures_of, readings_of

from exosight.dataset import read_frames
from exosight.dataset.matlab import write_mat
from exosight.errors import ExosightError, InputError

COUNT = 12
AXES = {"HWN": (1, 2, 0), "NHW": (0, 1, 2), "WHN": (2, 1, 0), "NWH": (0, 2, 1)}
"""From pictures × height × width to each order."""


def write_73(path: Path, values: dict[str, np.ndarray]) -> None:
    """As MATLAB's save -v7.3 does: HDF5 behind 512 bytes, dimensions in reverse."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in values.items():
            file.create_dataset(name, data=value.T, compression="gzip")
            file[name].attrs["MATLAB_class"] = np.bytes_(value.dtype.name)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, made up".ljust(512))


@pytest.mark.parametrize("version", ["5", "7.3"])
@pytest.mark.parametrize("order", list(AXES))
def test_pictures_come_back_from_every_order(tmp_path: Path, version: str, order: str) -> None:
    values = {
        "photos": np.transpose(pictures_of(COUNT), AXES[order]),
        "thumb": readings_of(COUNT)[:, :1],
        "forces": readings_of(COUNT).T,
        "label": np.full((1, 1), 3.0),
    }
    path = tmp_path / "data.mat"
    (write_mat if version == "5" else write_73)(path, values)
    said = order if order in ("WHN", "NWH") else None
    imported(path, tmp_path / "data", order=said, unit="mN")
    frames = read_frames(tmp_path / "data")
    np.testing.assert_array_equal(frames.images, pictures_of(COUNT))
    assert set(frames.schema.outputs) == {"thumb", "forces_1", "forces_2"}
    np.testing.assert_array_equal(frames.reading("forces_2"), np.float32(readings_of(COUNT)[:, 1] * 1e-3))


@pytest.mark.parametrize(
    ("kind", "factor"), [(np.float64, 1 / 255), (np.float32, 1.0), (np.uint16, 257), (np.int16, 1)]
)
def test_gray_values_of_every_type(tmp_path: Path, kind: type, factor: float) -> None:
    pictures = pictures_of(COUNT)
    write_mat(
        tmp_path / "data.mat",
        {"photos": (pictures * kind(factor)).astype(kind), "f": readings_of(COUNT)[:, :1]},
    )
    imported(tmp_path / "data.mat", tmp_path / "data", sensors=("f [N]",))
    np.testing.assert_array_equal(read_frames(tmp_path / "data").images, pictures)


def test_colours_and_names_from_a_list_of_texts(tmp_path: Path) -> None:
    colours = np.repeat(pictures_of(COUNT)[..., None], 3, axis=3)
    values = {
        "photos": np.transpose(colours, (1, 2, 3, 0)),
        "forces": readings_of(COUNT),
        "names": ["thumb [N]", "palm [kPa]"],
        "run": ["one"] * 5 + ["two"] * 7,
    }
    write_mat(tmp_path / "data.mat", values)
    manifest = imported(tmp_path / "data.mat", tmp_path / "data")
    frames = read_frames(tmp_path / "data")
    np.testing.assert_array_equal(frames.images, pictures_of(COUNT))
    assert [(s.name, s.unit) for s in frames.schema.sensors] == [("thumb", "N"), ("palm", "Pa")]
    assert [design.parameters["name"] for design in manifest.designs] == ["one", "two"]


@pytest.mark.parametrize(
    ("change", "options", "sentence"),
    [
        ({"photos": pictures_of(32, shape=(32, 32))}, {}, "order HWN or NHW; say which with --order"),
        ({"photos": pictures_of(5)}, {}, "is the number of readings"),
        ({"photos": pictures_of(COUNT)[0]}, {}, "expected one variable of three or four dimensions"),
        ({"more": pictures_of(COUNT)}, {}, "got photos, more; name it with --images"),
        ({}, {"images": "nothing"}, "in the variable nothing, got photos, f"),
        ({}, {"order": "HWCN"}, "order: expected one of HWN, NHW"),
        ({"photos": pictures_of(COUNT) * 30.0}, {}, "gray values from 0 to 7650"),
        ({"photos": pictures_of(COUNT).astype(np.uint16)}, {}, "which is black in 8 bits"),
    ],
)  # fmt: skip
def test_what_is_not_clear_is_one_sentence(
    tmp_path: Path, change: dict[str, np.ndarray], options: dict[str, str], sentence: str
) -> None:
    count = 32 if "HWN or NHW" in sentence else COUNT
    values = {"photos": pictures_of(COUNT), "f": readings_of(count)[:, :1]} | change
    write_mat(tmp_path / "data.mat", values)
    with pytest.raises(InputError, match=sentence):
        imported(tmp_path / "data.mat", tmp_path / "data", unit="N", **options)


@given(place=st.floats(0, 1), length=st.integers(1, 40), seed=st.integers(0, 99))
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_a_damaged_file_is_read_or_one_sentence(
    tmp_path_factory: pytest.TempPathFactory, place: float, length: int, seed: int
) -> None:
    folder = tmp_path_factory.mktemp("damaged")
    path = folder / "data.mat"
    write_73(path, {"photos": pictures_of(COUNT), "f": readings_of(COUNT)[:, :1]})
    content = bytearray(path.read_bytes())
    at = int(place * (len(content) - length))
    content[at : at + length] = np.random.default_rng(seed).bytes(length)
    path.write_bytes(bytes(content) if seed % 3 else bytes(content[:at]))
    with suppress(ExosightError):  # whose message is one line by construction
        imported(path, folder / "data", unit="N")

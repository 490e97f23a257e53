"""From pictures and tables to a dataset: what is stored, in which order, and what is refused."""

import io
import os
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from own_data import imported, pictures_of, readings_of
from PIL import Image

from exosight.dataset import make_split, read_frames, read_manifest, read_variation
from exosight.errors import DataError, ExosightError, InputError
from exosight.rig import importing


def test_pictures_and_readings_come_back(folder: Path, table: Path, tmp_path: Path) -> None:
    manifest = imported(folder, tmp_path / "data", table, system="hand")
    frames = read_frames(tmp_path / "data")
    assert read_manifest(tmp_path / "data") == manifest
    assert manifest.measured
    np.testing.assert_array_equal(frames.images, pictures_of(12))
    np.testing.assert_array_equal(frames.reading("thumb"), np.float32(readings_of(12)[:, 0] * 1e-3))
    np.testing.assert_array_equal(frames.reading("palm"), np.float32(readings_of(12)[:, 1]))
    assert [(s.name, s.unit, s.estimated) for s in frames.schema.sensors] == [
        ("thumb", "N", True),
        ("palm", "N", True),
    ]
    assert frames.design.tolist() == [0] * 6 + [1] * 6
    assert frames.step.tolist() == [*range(6)] * 2
    assert [design.parameters["name"] for design in manifest.designs] == ["a", "b"]


@given(
    data=st.data(),
    values=st.lists(st.floats(-1e6, 1e6, width=32), min_size=3, max_size=12, unique=True),
)
@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_rows_find_their_pictures_in_any_order(
    data: st.DataObject,
    values: list[float],
    tmp_path_factory: pytest.TempPathFactory,
    write: Callable[..., Path],
) -> None:
    place = tmp_path_factory.mktemp("any")
    names = data.draw(
        st.lists(
            st.text("abcxyz019_", min_size=1, max_size=8),
            min_size=len(values),
            max_size=len(values),
            unique=True,
        )
    )
    pictures = pictures_of(len(values))
    for name, picture in zip(names, pictures, strict=True):
        cv2.imwrite(str(place / f"{name}.png"), picture)
    runs = data.draw(st.lists(st.sampled_from("uvw"), min_size=len(values), max_size=len(values)))
    order = data.draw(st.permutations(range(len(values))))
    rows = [(f"{names[i]}.png", values[i], runs[i]) for i in order]
    imported(place, place / "data", write(("file", "x (N)", "run"), rows))
    frames, designs = read_frames(place / "data"), read_manifest(place / "data").designs
    found = {values[i]: (pictures[i].tobytes(), runs[i]) for i in range(len(values))}
    for image, reading, number in zip(frames.images, frames.reading("x"), frames.design, strict=True):
        name = designs[int(number)].parameters["name"]
        assert found[float(reading)] == (image.tobytes(), name)
    assert np.all(np.diff(frames.design) >= 0)


def test_rows_are_found_by_order_and_by_time(
    folder: Path, write: Callable[..., Path], tmp_path: Path
) -> None:
    values = readings_of(12)[:, 0]
    imported(folder, tmp_path / "order", write(("thumb [N]",), values[:, None].tolist()))
    np.testing.assert_array_equal(read_frames(tmp_path / "order").reading("thumb"), np.float32(values))
    # Instruments read every 10 ms, pictures are taken every 30 ms; the last after they stopped.
    names = write(("picture", "time [ms]"), [(f"p_{k}", 30 * k + 2) for k in range(12)], "times.csv")
    fast = write(("time [s]", "thumb [N]"), [(k / 100, k) for k in range(32)], "fast.csv")
    manifest = imported(folder, tmp_path / "time", fast, times=names, tolerance=0.004)
    assert read_frames(tmp_path / "time").reading("thumb").tolist() == [3.0 * k for k in range(11)]
    assert manifest.dropped["no_reading"] == 1
    np.testing.assert_allclose(read_variation(tmp_path / "time")["time"], 0.03 * np.arange(11))


def test_sequences_are_those_of_folders_or_stretches_and_decide_the_split(
    folder: Path, write: Callable[..., Path], tmp_path: Path
) -> None:
    table = write(("thumb [N]",), readings_of(12)[:, :1].tolist())
    manifest = imported(folder, tmp_path / "stretches", table, stretches=5)
    assert len(manifest.designs) == 5
    frames = read_frames(tmp_path / "stretches")
    split = make_split(frames, "design", 0)
    parts = [set(frames.design[part].tolist()) for part in (split.train, split.validation, split.test)]
    assert sum(map(len, parts)) == len(set.union(*parts)) == 5
    for number in range(12):
        (folder / "xy"[number % 2]).mkdir(exist_ok=True)
        os.rename(folder / f"p_{number}.png", folder / "xy"[number % 2] / f"p_{number}.png")
    manifest = imported(folder, tmp_path / "folders", table)
    assert [design.parameters["name"] for design in manifest.designs] == ["x", "y"]


def test_commands_are_channels_with_the_range_that_was_measured(
    folder: Path, write: Callable[..., Path], tmp_path: Path
) -> None:
    rows = [(value, 5 * value) for value in readings_of(12)[:, 0].tolist()]
    table = write(("thumb", "line [kPa]"), rows)
    imported(folder, tmp_path / "data", table, commands=("line",), unit="N")
    frames = read_frames(tmp_path / "data")
    (channel,) = frames.schema.channels
    assert (channel.name, channel.unit, channel.low, channel.high) == ("line", "Pa", 0.0, 5e3 * 11 / 8)
    np.testing.assert_allclose(frames.commands[:, 0], 5e3 * np.arange(12) / 8, rtol=1e-6)
    assert frames.schema.outputs == ("thumb",)


def test_a_stopped_import_goes_on_and_ends_as_one_that_was_not(
    folder: Path, table: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importing, "CHUNK_FRAMES", 5)
    whole = imported(folder, tmp_path / "whole", table)
    content = (folder / "p_7.png").read_bytes()
    (folder / "p_7.png").write_bytes(content[:200])
    with pytest.raises(DataError, match=r"p_7.png: not a picture.*what is stored stays.*--resume"):
        imported(folder, tmp_path / "data", table)
    first = (tmp_path / "data" / "chunk_0000.h5").stat().st_mtime_ns
    with pytest.raises(DataError, match="incomplete dataset"):
        read_manifest(tmp_path / "data")
    (folder / "p_7.png").write_bytes(content)
    assert imported(folder, tmp_path / "data", table, resume=True) == whole
    assert (tmp_path / "data" / "chunk_0000.h5").stat().st_mtime_ns == first
    for name in ("chunk_0002.h5", "README.md", "manifest.json"):
        assert (tmp_path / "data" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    other = cv2.imencode(".png", np.full_like(cv2.imread(str(folder / "p_0.png"), 0), 90))[1]
    (folder / "p_0.png").write_bytes(other.tobytes())
    imported(folder, tmp_path / "data", table, resume=True)  # a chunk is made again where a picture changed
    assert (read_frames(tmp_path / "data").images[0] == 90).all()
    with pytest.raises(DataError, match=r"exists already.*--resume"):
        imported(folder, tmp_path / "data", table)
    with pytest.raises(InputError, match="another configuration"):
        imported(folder, tmp_path / "data", table, system="other", resume=True)


def test_what_is_incomplete_is_left_out_if_that_is_asked_for(
    folder: Path, write: Callable[..., Path], tmp_path: Path
) -> None:
    rows = [(f"p_{k}.png", "" if k == 3 else k) for k in range(11)]
    table = write(("picture", "thumb [N]"), rows)
    (folder / "p_5.png").write_bytes(b"\x89PNG\r\n")
    with pytest.raises(InputError, match=r"no row for the picture p_11.png \(1 such pictures\)"):
        imported(folder, tmp_path / "data", table)
    manifest = imported(folder, tmp_path / "data", table, drop=True)
    assert manifest.dropped == {"no_reading": 1, "empty_cell": 1, "unreadable": 1}
    assert read_frames(tmp_path / "data").reading("thumb").tolist() == [0, 1, 2, 4, 6, 7, 8, 9, 10]


COLUMN = [[k] for k in range(12)]


@pytest.mark.parametrize(
    ("headings", "rows", "sentence"),
    [
        (["thumb"], COLUMN, "thumb has no unit; write it behind the name, like thumb"),
        (["thumb [N]"], [[1]] * 12, "is 1 in every row, so nothing can be learned"),
        (["thumb [N]"], COLUMN[:9], "9 rows for 12 pictures"),
        (["a [N]", "b [N]"], [[k if k != 9 else "", k] for k in range(12)], "is empty in row 10 .1 such"),
        (["thumb [N]"], [*COLUMN[:9], ["1.2.3"], *COLUMN[10:]], "expected numbers, got '1.2.3' in row 10"),
        (["thumb [N]"], [*COLUMN[:9], ["inf"], *COLUMN[10:]], "is inf in row 10; expected numbers up to"),
        (["9 [N]"], COLUMN, "a letter first"),
        (["thumb [N]", "thumb (N)"], [[k, k] for k in range(12)], "got thumb twice"),
        (["thumb [N]", "time [s]"], [[k, 9 - k] for k in range(12)], "falls from 9 s to 8 s in row 2"),
        (["thumb [N]", "time [N]"], [[k, k] for k in range(12)], "expected a unit of time, got N"),
        (["thumb [N]", "picture"], [[k, f"p_{k % 6}.png"] for k in range(12)], "p_0.png stands in two rows"),
        (["thumb [N]", "picture"], [[k, f"p_{k + 1}.png"] for k in range(12)], "row 12 is of p_12.png"),
        (["thumb [N]", "picture"], [[k, f"q_{k}.png"] for k in range(12)], "none of the names in picture"),
        (["thumb [N]"], [[k, k] for k in range(12)], "row 1 has 2 cells, the headings have 1"),
    ],
)  # fmt: skip
def test_a_table_that_does_not_fit_is_one_sentence(
    folder: Path,
    write: Callable[..., Path],
    tmp_path: Path,
    headings: list[str],
    rows: list[list[object]],
    sentence: str,
) -> None:
    with pytest.raises(ExosightError, match=sentence):
        imported(folder, tmp_path / "data", write(headings, rows))
    assert not (tmp_path / "data").exists()


def test_pictures_of_two_sizes_are_refused(folder: Path, table: Path, tmp_path: Path) -> None:
    cv2.imwrite(str(folder / "p_8.png"), np.zeros((40, 36), np.uint8))
    with pytest.raises(
        InputError, match=r"p_8\.png: expected 36×32 pixels as the first picture has, got 36×40"
    ):
        imported(folder, tmp_path / "data", table)


def test_turned_and_deep_pictures_are_said(folder: Path, table: Path, tmp_path: Path) -> None:
    turned = Image.fromarray(np.rot90(pictures_of(12)[2], axes=(1, 0)))  # to be turned back: orientation 8
    exif = Image.Exif()
    exif[0x0112] = 8
    turned.save(folder / "p_2.png", exif=exif)
    cv2.imwrite(str(folder / "p_4.png"), pictures_of(12)[4].astype(np.uint16) * 257)
    with importing.prepare(folder, importing.ImportConfig(), table) as found:
        importing.store(found, tmp_path / "data")
    assert found.pictures.notes == [
        "1 pictures were turned as their EXIF orientation says",
        "of 1 pictures with 16 bits a pixel the upper 8 were taken",
    ]
    np.testing.assert_array_equal(read_frames(tmp_path / "data").images, pictures_of(12))
    cv2.imwrite(str(folder / "p_4.png"), pictures_of(12)[4].astype(np.uint16))
    with pytest.raises(DataError, match="no value above 255 of 65535, which is black in 8 bits"):
        imported(folder, tmp_path / "dark", table)


def test_colours_become_gray_by_rec_601(folder: Path, table: Path, tmp_path: Path) -> None:
    colours = pictures_of(1, 3, (32, 36, 3))[0]
    cv2.imwrite(str(folder / "p_0.png"), colours)
    imported(folder, tmp_path / "data", table)
    blue, green, red = np.moveaxis(colours.astype(float), -1, 0)
    expected = 0.299 * red + 0.587 * green + 0.114 * blue
    # Whole numbers, rounded either way.
    assert np.abs(read_frames(tmp_path / "data").images[0] - expected).max() <= 1


def test_a_part_of_the_pictures_is_stored_in_the_size_asked_for(
    folder: Path, table: Path, tmp_path: Path
) -> None:
    imported(folder, tmp_path / "part", table, crop=(4, 0, 32, 32))
    np.testing.assert_array_equal(read_frames(tmp_path / "part").images, pictures_of(12)[:, :, 4:])
    imported(folder, tmp_path / "large", table, size=(72, 64))
    assert read_frames(tmp_path / "large").images.shape == (12, 64, 72)
    for options, sentence in (
        ({"crop": (10, 0, 32, 32)}, "crop: expected left, top, width and height within 36×32"),
        ({"size": (64, 64)}, "expected the aspect ratio of 36×32 pixels, got 64×64"),
        ({"size": (36, 30)}, "sides of 32 to 1024 pixels in multiples of 4"),
        ({"order": "HWN"}, "an option of .mat files"),
    ):
        with pytest.raises(InputError, match=sentence):
            imported(folder, tmp_path / "none", table, **options)


def test_sources_that_are_none_are_one_sentence(folder: Path, table: Path, tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    for source, given_table, sentence in (
        (empty, table, "no pictures in it"),
        (tmp_path / "nothing", table, "not there; expected a folder of pictures, a video"),
        (table, table, "not a video that can be read"),
        (folder, None, "expected a table of readings"),
        (folder, tmp_path / "nothing.csv", "no such file"),
        (folder, folder / "p_0.png", "no text"),
    ):
        with pytest.raises(ExosightError, match=sentence):
            imported(source, tmp_path / "data", given_table)
    stream = io.BytesIO()
    np.save(stream, np.arange(3))
    (tmp_path / "other.csv").write_bytes(stream.getvalue())
    with pytest.raises(DataError, match="no text"):
        imported(folder, tmp_path / "data", tmp_path / "other.csv")

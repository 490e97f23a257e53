"""Pictures from files: gray, in the wanted size, or refused in one sentence."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from exosight.errors import DataError, InputError
from exosight.vision.pictures import read_gray


def write(path: Path, picture: np.ndarray) -> Path:
    assert cv2.imwrite(str(path), picture)
    return path


def test_a_gray_png_of_the_size_comes_back_as_it_is(tmp_path: Path) -> None:
    picture = np.random.default_rng(0).integers(0, 256, (48, 64), np.uint8)
    assert np.array_equal(read_gray(write(tmp_path / "a.png", picture), 64, 48), picture)


def test_colours_become_gray_by_rec_601(tmp_path: Path) -> None:
    picture = np.zeros((8, 8, 3), np.uint8)
    picture[:] = (10, 200, 100)  # blue, green, red
    # 0.299 R + 0.587 G + 0.114 B, rounded.
    assert np.all(read_gray(write(tmp_path / "a.png", picture), 8, 8) == round(29.9 + 117.4 + 1.14))


def test_a_large_picture_shrinks_to_the_means_of_its_blocks(tmp_path: Path) -> None:
    picture = np.random.default_rng(0).integers(0, 256, (64, 96), np.uint8)
    expected = picture.reshape(16, 4, 24, 4).mean((1, 3))
    # Rounded to whole grays.
    found = read_gray(write(tmp_path / "a.png", picture), 24, 16)
    assert np.abs(found - expected).max() <= 0.5 + 1e-6


def test_another_aspect_ratio_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.png", np.zeros((100, 200), np.uint8))
    with pytest.raises(DataError, match=r"expected a square picture, got 200×100 pixels; crop it"):
        read_gray(path, 128, 128)
    with pytest.raises(DataError, match=r"expected the aspect ratio 160:120, got 200×100 pixels; crop it"):
        read_gray(path, 160, 120)


def test_a_crop_makes_any_picture_fit_and_must_lie_within_it(tmp_path: Path) -> None:
    picture = np.zeros((480, 640), np.uint8)
    picture[:, 80:560] = 200
    path = write(tmp_path / "a.png", picture)
    with pytest.raises(DataError, match="--crop 80 0 480 takes its middle"):
        read_gray(path, 128, 128)
    assert np.all(read_gray(path, 128, 128, (80, 0, 480)) == 200)
    for crop in ((161, 0, 480), (80, 1, 480), (-1, 0, 10), (0, 0, 0)):
        with pytest.raises(InputError, match=f"within the 640×480 of {path}, got {crop[0]} {crop[1]}"):
            read_gray(path, 128, 128, crop)


def test_one_pixel_more_on_a_side_is_no_other_aspect_ratio(tmp_path: Path) -> None:
    path = write(tmp_path / "a.png", np.full((480, 481), 7, np.uint8))
    assert np.all(read_gray(path, 128, 128) == 7)


def test_a_missing_file_and_a_folder_are_told(tmp_path: Path) -> None:
    for path in (tmp_path / "none.png", tmp_path):
        with pytest.raises(DataError, match="cannot be read"):
            read_gray(path, 8, 8)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.binary(max_size=400), cut=st.integers(0, 200), whole=st.booleans())
def test_any_other_file_is_refused_or_read_never_more(
    tmp_path: Path, data: bytes, cut: int, whole: bool
) -> None:
    good = cv2.imencode(".png", np.zeros((8, 8), np.uint8))[1].tobytes()
    path = tmp_path / "a.png"
    path.write_bytes(data if whole else good[: cut % len(good)] + data)
    try:
        found = read_gray(path, 8, 8)
    except DataError:
        return
    assert found.shape == (8, 8)
    assert found.dtype == np.uint8

"""Pictures from files: gray, in the wanted size, or refused in one sentence."""

import io
import os
import struct
import zlib
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

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


def saved(kind: str, width: int, height: int, **options: object) -> bytes:
    Image.effect_noise((width, height), 40).save(content := io.BytesIO(), kind, **options)
    return content.getvalue()


def claiming(kind: str, side: int) -> bytes:
    """A few bytes of a picture that says it has so many pixels a side."""
    if kind == "PNG":
        head = b"IHDR" + struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
        image = b"IDAT" + zlib.compress(bytes(100))
        return b"\x89PNG\r\n\x1a\n" + b"".join(
            struct.pack(">I", len(part) - 4) + part + struct.pack(">I", zlib.crc32(part))
            for part in (head, image, b"IEND")
        )
    content = bytearray(saved(kind, 3, 5))
    if kind == "BMP":
        content[18:26] = struct.pack("<ii", side, side)
    elif kind == "JPEG":
        at = content.index(b"\xff\xc0") + 5
        content[at : at + 4] = struct.pack(">HH", side, side)
    elif kind == "TIFF":
        for tag in (256, 257):
            at = next(
                content.index(struct.pack("<HHI", tag, kind, 1))
                for kind in (3, 4)
                if struct.pack("<HHI", tag, kind, 1) in content
            )
            content[at : at + 12] = struct.pack("<HHII", tag, 4, 1, side)
    return bytes(content)


@pytest.mark.parametrize("kind", ["PNG", "BMP", "JPEG", "TIFF"])
@pytest.mark.parametrize(
    ("side", "said"), [(8000, "8000×8000 pixels, up to 40 million"), (32000, "40 million")]
)
def test_the_size_is_read_before_anything_is_unpacked(
    tmp_path: Path, kind: str, side: int, said: str
) -> None:
    (path := tmp_path / "a").write_bytes(claiming(kind, side))
    with pytest.raises(DataError, match=said):
        read_gray(path, 8, 8)


def test_kinds_that_are_not_listed_are_refused(tmp_path: Path) -> None:
    gif = b"GIF89a" + struct.pack("<HH", 32000, 32000) + bytes(25)
    for content in (gif, b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n", saved("GIF", 8, 8)):
        (path := tmp_path / "a.png").write_bytes(content)
        with pytest.raises(DataError, match="not a picture that can be read"):
            read_gray(path, 8, 8)


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.png")
    with pytest.raises(DataError, match="a device or a pipe"):
        read_gray(tmp_path / "a.png", 8, 8)


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "TIFF", "BMP", "WEBP"])
def test_damaged_pictures_are_refused_in_silence(
    tmp_path: Path, kind: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """Decoders in C write to the process's stderr themselves, and what Pillow logs ends there too."""
    whole = saved(kind, 64, 64, **({"compression": "tiff_lzw"} if kind == "TIFF" else {}))
    draw = np.random.default_rng(3)
    (path := tmp_path / "a").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DataError, match="not a picture that can be read, or damaged"):
        read_gray(path, 64, 64)
    for _ in range(200):
        content = np.frombuffer(whole, np.uint8).copy()
        content[draw.integers(0, len(content), 4)] = draw.integers(0, 256, 4)
        path.write_bytes(content.tobytes())
        with suppress(DataError):
            assert read_gray(path, 64, 64).shape == (64, 64)
    assert capfd.readouterr() == ("", "")


def test_pictures_of_16_bits_keep_their_higher_8(tmp_path: Path) -> None:
    picture = np.random.default_rng(0).integers(0, 2**16, (8, 8), np.uint16)
    for name in ("a.png", "a.tif"):
        assert np.array_equal(read_gray(write(tmp_path / name, picture), 8, 8), picture >> 8)
        colours = np.repeat(picture[..., None], 3, axis=2)
        # Weights of equal colours add up to 1; the sum is rounded.
        found = read_gray(write(tmp_path / name, colours), 8, 8).astype(int)
        assert np.abs(found - (picture >> 8)).max() <= 1


def test_a_picture_that_was_taken_upright_is_read_upright(tmp_path: Path) -> None:
    picture = Image.effect_noise((8, 8), 40)
    exif = picture.getexif()
    exif[0x0112] = 6  # to be turned by 90 degrees clockwise
    picture.save(tmp_path / "a.png", exif=exif)
    assert np.array_equal(read_gray(tmp_path / "a.png", 8, 8), np.rot90(np.asarray(picture), -1))

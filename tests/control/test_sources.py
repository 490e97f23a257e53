"""Frames from folders, videos and cameras: in order, in the right shape, with their times."""

import itertools
import struct
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from exosight.control import sources
from exosight.control.sources import fitted, open_source
from exosight.errors import DataError, InputError


def write_video(path: Path, grays: list[int], columns: int = 64, rows: int = 48) -> None:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, (columns, rows))
    assert writer.isOpened()
    for gray in grays:
        writer.write(np.full((rows, columns, 3), gray, np.uint8))
    writer.release()


class Webcam:
    """Stands in for OpenCV's capture: gives what it is told to, then nothing, as one that is unplugged."""

    def __init__(self, pictures: list[np.ndarray]) -> None:
        self.pictures, self.released = list(pictures), False

    def isOpened(self) -> bool:
        return True

    def read(self) -> tuple[bool, np.ndarray | None]:
        return (True, self.pictures.pop(0)) if self.pictures else (False, None)

    def release(self) -> None:
        self.released = True


def plug_in(monkeypatch: pytest.MonkeyPatch, pictures: list[np.ndarray]) -> Webcam:
    webcam = Webcam(pictures)
    monkeypatch.setattr(sources.cv2, "VideoCapture", lambda number, backend: webcam)
    return webcam


def soon(frames: sources.FrameStream) -> sources.Frame:
    """The next frame, once the camera's thread has grabbed one."""
    for frame in itertools.islice(frames, 400):
        if frame is not None:
            return frame
        time.sleep(0.01)
    raise AssertionError("no frame in 4 s")


# Pictures


def test_fitted_keeps_gray_values_and_takes_the_middle() -> None:
    picture = np.zeros((20, 40, 3), np.uint8)
    picture[:, 10:30] = 200  # the middle square, of equal red, green and blue
    assert (fitted(picture, 10, 10, None, "a") == 200).all()
    assert (fitted(picture, 10, 10, (0, 0, 10), "a") == 0).all()


def test_fitted_weighs_colours_by_rec_601() -> None:
    blue, green, red = 30, 120, 210
    picture = np.tile(np.array([blue, green, red], np.uint8), (8, 8, 1))
    expected = 0.299 * red + 0.587 * green + 0.114 * blue
    # Rounded once to a gray level, with OpenCV's weights in fixed point.
    assert np.abs(fitted(picture, 4, 4, None, "a").astype(float) - expected).max() <= 1


@pytest.mark.parametrize("crop", [(-1, 0, 10), (0, 0, 21), (31, 0, 10), (0, 11, 10), (0, 0, 0)])
def test_a_crop_outside_the_picture_is_refused(crop: tuple[int, int, int]) -> None:
    with pytest.raises(InputError, match="crop"):
        fitted(np.zeros((20, 40), np.uint8), 10, 10, crop, "a")


# Files


def test_a_folder_shows_its_pictures_in_the_order_of_names(tmp_path: Path) -> None:
    for name, gray in (("b.png", 20), ("a.png", 10), ("c.PNG", 30)):
        cv2.imwrite(str(tmp_path / name), np.full((16, 16), gray, np.uint8))
    (tmp_path / "notes.txt").write_text("not a picture")
    frames = [frame for frame in open_source(str(tmp_path), 8, 8) if frame]
    assert [int(frame.image[0, 0]) for frame in frames] == [10, 20, 30]
    assert all(frame.image.shape == (8, 8) for frame in frames)
    assert frames[0].time <= frames[1].time <= frames[2].time


def test_a_picture_that_cannot_be_read_is_a_missing_frame_and_told(tmp_path: Path) -> None:
    for name, side in (("a.png", 8), ("c.png", 8), ("d.png", 12)):
        cv2.imwrite(str(tmp_path / name), np.zeros((side, 8), np.uint8))
    (tmp_path / "b.png").write_bytes(b"not a picture")
    faults: list[str] = []
    frames = list(open_source(str(tmp_path), 8, 8, unread=faults.append))
    assert [frame is not None for frame in frames] == [True, False, True, False]
    assert [fault.partition(":")[0] for fault in faults] == [
        str(tmp_path / name) for name in ("b.png", "d.png")
    ]


def test_a_crop_acts_on_the_pictures_of_a_folder(tmp_path: Path) -> None:
    picture = np.zeros((48, 64), np.uint8)
    picture[:, 8:56] = 200
    cv2.imwrite(str(tmp_path / "a.png"), picture)
    with pytest.raises(DataError, match="crop it, --crop 8 0 48"):
        open_source(str(tmp_path), 32, 32)
    with pytest.raises(InputError, match="within the 64×48"):
        open_source(str(tmp_path), 32, 32, crop=(20, 0, 48))
    (frame,) = open_source(str(tmp_path), 32, 32, crop=(8, 0, 48))
    assert frame is not None
    assert (frame.image == 200).all()


def test_a_video_shows_every_frame_and_ends(tmp_path: Path) -> None:
    write_video(tmp_path / "run.avi", [10, 100, 200])
    frames = [frame for frame in open_source(str(tmp_path / "run.avi"), 32, 32) if frame]
    # JPEG of an even gray is off by a level or two.
    assert [float(frame.image.mean()) for frame in frames] == pytest.approx([10, 100, 200], abs=3)


def test_what_is_no_source_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="source"):
        open_source(str(tmp_path / "nothing"), 8, 8)
    with pytest.raises(DataError, match="no pictures"):
        open_source(str(tmp_path), 8, 8)
    (tmp_path / "film.avi").write_text("not a video")
    with pytest.raises(DataError, match="not a video"):
        open_source(str(tmp_path / "film.avi"), 8, 8)
    (tmp_path / "a.png").write_text("not a picture")
    with pytest.raises(DataError, match="not a picture"):
        open_source(str(tmp_path), 8, 8)


@pytest.mark.parametrize(
    "playlist", ["ffconcat version 1.0\nfile run.avi\n", "#EXTM3U\n#EXTINF:10,\nrun.avi\n#EXT-X-ENDLIST\n"]
)
def test_a_playlist_that_names_another_video_is_refused(
    tmp_path: Path, playlist: str, capfd: pytest.CaptureFixture[str]
) -> None:
    write_video(tmp_path / "run.avi", [10])
    (tmp_path / "list.mp4").write_text(playlist)
    with pytest.raises(DataError, match="not a video"):
        open_source(str(tmp_path / "list.mp4"), 8, 8)
    assert not capfd.readouterr().err


def test_a_video_of_huge_pictures_is_refused_before_one_is_decoded(tmp_path: Path) -> None:
    write_video(tmp_path / "run.avi", [10], columns=64, rows=32)
    content = (tmp_path / "run.avi").read_bytes()
    assert content.count(struct.pack("<II", 64, 32)) == 2  # of the whole, and of its one stream
    content = content.replace(struct.pack("<II", 64, 32), struct.pack("<II", 12_000, 12_000))
    # A JPEG says its height and width after its sample precision of 8 bits.
    content = content.replace(struct.pack(">BHH", 8, 32, 64), struct.pack(">BHH", 8, 12_000, 12_000))
    (tmp_path / "run.avi").write_bytes(content)
    with pytest.raises(DataError, match="12000×12000 pixels, up to 40 million are read"):
        open_source(str(tmp_path / "run.avi"), 8, 8)


def test_a_damaged_video_is_refused_in_silence(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    write_video(tmp_path / "run.avi", [10, 20])
    content = (tmp_path / "run.avi").read_bytes()
    (tmp_path / "run.avi").write_bytes(content[:400] + bytes(len(content) - 400))
    with pytest.raises(DataError, match="not a video"):
        open_source(str(tmp_path / "run.avi"), 8, 8)
    assert not capfd.readouterr().err


def test_a_crop_outside_a_video_is_refused_at_once(tmp_path: Path) -> None:
    write_video(tmp_path / "run.avi", [10])
    with pytest.raises(InputError, match="crop"):
        open_source(str(tmp_path / "run.avi"), 32, 32, crop=(0, 0, 49))


# Cameras


def test_a_camera_gives_its_newest_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    webcam = plug_in(monkeypatch, [np.full((48, 64, 3), gray, np.uint8) for gray in (10, 20, 30)])
    frames = open_source("0", 32, 32)
    soon(frames)
    while webcam.pictures:
        time.sleep(0.001)
    time.sleep(0.05)  # the thread takes note of the last one
    newest = next(frames)
    assert newest is not None
    assert int(newest.image[0, 0]) == 30
    again = next(frames)
    assert again is newest  # the same, and as old as it is
    frames.close()
    assert webcam.released


def test_a_camera_that_stops_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    plug_in(monkeypatch, [np.zeros((48, 64, 3), np.uint8)])
    monkeypatch.setattr(sources, "GIVEN_UP", 0.05)
    frames = open_source("0", 32, 32)
    soon(frames)
    time.sleep(0.1)
    with pytest.raises(DataError, match="no frame for"):
        next(frames)


def test_a_camera_without_a_frame_is_refused_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    webcam = plug_in(monkeypatch, [])
    monkeypatch.setattr(sources, "GIVEN_UP", 0.05)
    with pytest.raises(DataError, match="no frame for"):
        open_source("0", 32, 32)
    assert webcam.released


def test_a_crop_outside_a_camera_s_picture_is_refused_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    webcam = plug_in(monkeypatch, [np.zeros((48, 64, 3), np.uint8)] * 9)
    with pytest.raises(InputError, match="within the 64×48 of camera 0"):
        open_source("0", 32, 32, crop=(20, 0, 48))
    assert webcam.released


def test_a_camera_that_is_not_there_is_refused() -> None:
    with pytest.raises(DataError, match="camera 63"):
        open_source("63", 32, 32)

"""A video as a source of pictures, whose frames find their readings by time or by order."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from own_data import imported

from exosight.dataset import read_frames
from exosight.errors import ExosightError
from exosight.rig.video import Video

GRAYS = np.arange(10, 250, 24, dtype=np.uint8)


@pytest.fixture
def video(tmp_path: Path) -> Path:
    """Ten gray frames at 25 Hz."""
    path = tmp_path / "run.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (48, 32))
    for gray in GRAYS:
        writer.write(np.full((32, 48, 3), gray, np.uint8))
    writer.release()
    return path


def test_frames_are_read_in_any_order_with_their_times(video: Path) -> None:
    found = Video(video)
    np.testing.assert_allclose(found.times, np.arange(10) / 25, atol=1e-3)  # the container counts in ms
    for place in (0, 3, 4, 9, 1):
        assert np.abs(found.picture(place).astype(int) - GRAYS[place]).max() <= 2  # JPEG rounds
    found.close()


def test_rows_by_order_and_by_time(video: Path, write: Callable[..., Path], tmp_path: Path) -> None:
    imported(video, tmp_path / "order", write(("f [N]",), [[k] for k in range(10)]))
    frames = read_frames(tmp_path / "order")
    assert frames.images.shape == (10, 32, 48)
    assert frames.reading("f").tolist() == list(range(10))
    rows = [(k / 100, k) for k in range(60)]
    imported(video, tmp_path / "time", write(("t [s]", "f [N]"), rows))
    assert read_frames(tmp_path / "time").reading("f").tolist() == [4.0 * k for k in range(10)]


def test_a_truncated_video_is_one_sentence(video: Path, write: Callable[..., Path], tmp_path: Path) -> None:
    content = video.read_bytes()
    table = write(("f [N]",), [[k] for k in range(10)])
    for share in (0.01, 0.6):
        video.write_bytes(content[: int(share * len(content))])
        with pytest.raises(ExosightError, match=r"not a video|rows for . pictures"):
            imported(video, tmp_path / "data", table)

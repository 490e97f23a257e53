"""LeRobot datasets of versions 2.1 and 3.0, written as the format says and read back."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from own_data import imported

from exosight.dataset import read_frames, read_manifest
from exosight.errors import DataError, ExosightError, InputError

av = pytest.importorskip("av", reason="needs the extra 'lerobot'")
pa = pytest.importorskip("pyarrow", reason="needs the extra 'lerobot'")
parquet = pytest.importorskip("pyarrow.parquet", reason="needs the extra 'lerobot'")

FPS, LENGTHS = 10, (5, 7, 4)
KEY, HIGH, WIDE = "observation.images.side", 32, 48
FRAMES = sum(LENGTHS)
GRAYS = np.arange(20, 20 + 14 * FRAMES, 14) % 251
FORCES = np.column_stack([np.arange(FRAMES) / 8, np.cos(np.arange(FRAMES))])
SENSORS = {"sensors": ("ft_fx [N]", "ft_fz [mN]"), "commands": ("action [kPa]",)}
Write = Callable[..., Path]


def write_video(path: Path, grays: np.ndarray, codec: str = "mpeg4") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as file:
        stream: Any = file.add_stream(codec, rate=FPS)
        stream.width, stream.height, stream.pix_fmt = WIDE, HIGH, "yuv420p"
        for gray in grays.tolist():
            picture = np.full((HIGH, WIDE, 3), gray, np.uint8)
            file.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "bgr24")))
        file.mux(stream.encode(None))


def write_parquet(path: Path, columns: dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    parquet.write_table(pa.table(columns), path)


def numbers(values: np.ndarray) -> Any:
    """A column with a list of numbers a row, of one length as lerobot writes it."""
    flat = pa.array(values.astype(np.float32).ravel())
    return pa.FixedSizeListArray.from_arrays(flat, values.shape[1])


def frames_of(episodes: list[int], stored: str) -> dict[str, Any]:
    starts = np.concatenate([[0], np.cumsum(LENGTHS)])
    rows = np.concatenate([np.arange(starts[k], starts[k + 1]) for k in episodes])
    frame = np.concatenate([np.arange(LENGTHS[k]) for k in episodes])
    columns = {
        "observation.ft": numbers(FORCES[rows]),
        "action": pa.array((rows / 4).astype(np.float32)),
        "timestamp": pa.array((frame / FPS).astype(np.float32)),
        "frame_index": pa.array(frame),
        "episode_index": pa.array(np.repeat(episodes, [LENGTHS[k] for k in episodes])),
        "index": pa.array(rows),
        "task_index": pa.array(0 * rows),
        "next.done": pa.array(frame < 0),
    }
    if stored == "image":
        pictures = [np.full((HIGH, WIDE), gray, np.uint8) for gray in GRAYS[rows]]
        entries = [{"bytes": cv2.imencode(".png", each)[1].tobytes(), "path": ""} for each in pictures]
        columns[KEY] = pa.array(entries, pa.struct({"bytes": pa.binary(), "path": pa.string()}))
    return columns


def feature(dtype: str, shape: list[int], names: Any = None) -> dict[str, Any]:
    return {"dtype": dtype, "shape": shape, "names": names}


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Write three episodes: write(version, stored, codec, **changes of info.json)."""

    def call(version: str = "v3.0", stored: str = "video", codec: str = "mpeg4", **changes: Any) -> Path:
        root = tmp_path / "lerobot"
        info = {
            "codebase_version": version,
            "robot_type": "exosuit",
            "total_episodes": len(LENGTHS),
            "fps": FPS,
            "chunks_size": 2,
            "data_path": "../../{episode_index.__class__}",  # templates are not followed
            "features": {
                KEY: feature(stored, [HIGH, WIDE, 3], ["height", "width", "channels"]),
                "observation.ft": feature("float32", [2], {"axes": ["fx", "fz"]}),
                "action": feature("float32", [1]),
                **{name: feature("int64", [1]) for name in ("frame_index", "episode_index", "index")},
                "timestamp": feature("float32", [1]),
                "next.done": feature("bool", [1]),
            },
        }
        (root / "meta").mkdir(parents=True)
        (root / "meta" / "info.json").write_text(json.dumps(info | changes))
        bounds = np.concatenate([[0], np.cumsum(LENGTHS)])
        if version.startswith("v2"):
            for k in range(len(LENGTHS)):
                place = f"chunk-{k // 2:03d}"
                write_parquet(root / "data" / place / f"episode_{k:06d}.parquet", frames_of([k], stored))
                if stored == "video":
                    grays = GRAYS[bounds[k] : bounds[k + 1]]
                    write_video(root / "videos" / place / KEY / f"episode_{k:06d}.mp4", grays, codec)
        else:
            write_parquet(root / "data" / "chunk-000" / "file-000.parquet", frames_of([0, 1], stored))
            write_parquet(root / "data" / "chunk-000" / "file-001.parquet", frames_of([2], stored))
            if stored == "video":
                videos = root / "videos" / KEY / "chunk-000"
                write_video(videos / "file-000.mp4", GRAYS[: bounds[1]], codec)
                write_video(videos / "file-001.mp4", GRAYS[bounds[1] :], codec)
                said = {
                    "episode_index": [0, 1, 2],
                    f"videos/{KEY}/chunk_index": [0, 0, 0],
                    f"videos/{KEY}/file_index": [0, 1, 1],
                    f"videos/{KEY}/from_timestamp": [0.0, 0.0, LENGTHS[1] / FPS],
                }
                write_parquet(root / "meta" / "episodes" / "chunk-000" / "file-000.parquet", said)
        return root

    return call


@pytest.mark.parametrize(
    ("version", "stored", "codec"),
    [
        ("v2.1", "video", "mpeg4"),
        ("v2.1", "image", ""),
        ("v3.0", "video", "mpeg4"),
        ("v3.0", "video", "libsvtav1"),
        ("v3.0", "image", ""),
    ],
)
def test_pictures_readings_and_episodes_come_back(
    write: Write, tmp_path: Path, version: str, stored: str, codec: str
) -> None:
    if codec and codec not in av.codecs_available:
        pytest.skip(f"PyAV is built without {codec}")
    imported(write(version, stored, codec), tmp_path / "data", **SENSORS)
    frames, manifest = read_frames(tmp_path / "data"), read_manifest(tmp_path / "data")
    # Numbers of single precision, converted from mN.
    np.testing.assert_allclose(frames.reading("ft_fx"), FORCES[:, 0], rtol=1e-6)
    np.testing.assert_allclose(frames.reading("ft_fz"), 1e-3 * FORCES[:, 1], rtol=1e-6)
    np.testing.assert_allclose(frames.commands[:, 0], 1e3 * np.arange(FRAMES) / 4, rtol=1e-6)
    assert frames.design.tolist() == np.repeat([0, 1, 2], LENGTHS).tolist()
    assert [d.parameters["name"] for d in manifest.designs] == [f"episode {k}" for k in range(3)]
    # Compression costs some grays; neighbouring frames differ by 14, so half of that tells them apart.
    apart = 0 if stored == "image" else 6
    assert np.abs(frames.images.astype(int) - GRAYS[:, None, None]).max() <= apart


def test_the_one_camera_or_the_named_one(write: Write, tmp_path: Path) -> None:
    root = write()
    info = json.loads((root / "meta" / "info.json").read_text())
    other = "observation.images.top"
    info["features"][other] = feature("video", [HIGH, WIDE, 3])
    (root / "meta" / "info.json").write_text(json.dumps(info))
    with pytest.raises(InputError, match=rf"{KEY}, {other}; choose one with --images"):
        imported(root, tmp_path / "data", **SENSORS)
    with pytest.raises(InputError, match=f"a feature with pictures, {KEY}, {other}, got top"):
        imported(root, tmp_path / "data", images="top", **SENSORS)
    imported(root, tmp_path / "data", images=KEY, **SENSORS)
    # Nothing says in which unit the readings are.
    with pytest.raises(InputError, match="ft_fx has no unit"):
        imported(root, tmp_path / "other", images=KEY, sensors=("ft_fx",))


def test_a_table_takes_the_place_of_the_readings(write: Write, tmp_path: Path) -> None:
    table = tmp_path / "table.csv"
    table.write_text("\n".join(["f [N]", *(str(k) for k in range(FRAMES))]))
    imported(write(), tmp_path / "data", table)
    frames = read_frames(tmp_path / "data")
    assert frames.reading("f").tolist() == list(range(FRAMES))
    assert frames.design.tolist() == np.repeat([0, 1, 2], LENGTHS).tolist()


def truncate(path: Path, share: float) -> None:
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])


def test_what_does_not_fit_is_one_sentence(write: Write, tmp_path: Path) -> None:
    root = write()
    data = root / "data" / "chunk-000" / "file-000.parquet"
    episodes = root / "meta" / "episodes" / "chunk-000" / "file-000.parquet"
    video = root / "videos" / KEY / "chunk-000" / "file-001.mp4"
    description = root / "meta" / "info.json"
    info = json.loads(description.read_text())

    def changed(path: Path, **columns: Any) -> bytes:
        other = tmp_path / "changed.parquet"
        write_parquet(other, dict(parquet.read_table(path).to_pydict()) | columns)
        return other.read_bytes()

    def said(**changes: Any) -> bytes:
        return json.dumps(info | changes).encode()

    features = info["features"]
    wrong: list[tuple[Path, bytes, str]] = [
        (description, said(codebase_version="v1.6"), "version 2 or 3, got 'v1.6'"),
        (description, said(fps=0), "fps"),
        (description, b"[" * 100_000, "no description of a LeRobot dataset"),
        (description, said(features={}), "one feature with pictures, got none"),
        (description, said(features=features | {"more": feature("float32", [1])}), "a column more"),
        (description, said(features=features | {"action": feature("float32", [3])}), "cannot be read"),
        (description, said(features={"../../x": feature("video", [1])}), "a name of a folder"),
        (data, data.read_bytes()[:500], r"cannot be read .*ArrowInvalid"),
        (data, changed(data, **{"observation.ft": [[0.0] * (1 + 2 * (k % 2)) for k in range(12)]}), "cannot"),
        (episodes, b"", "cannot be read"),
        (video, b"", "cannot be read"),
        (video, b"#EXTM3U\nhttp://localhost/secret.ts\n", "cannot be read"),
    ]
    good = {path: path.read_bytes() for path in (data, episodes, video, description)}
    wrong += [
        (data, changed(data, frame_index=[-1] * (LENGTHS[0] + LENGTHS[1])), "whole numbers from 0"),
        (data, changed(data, timestamp=[None] * (LENGTHS[0] + LENGTHS[1])), "a number in each row"),
        (episodes, changed(episodes, **{f"videos/{KEY}/chunk_index": [0, 0, -1]}), "whole numbers from 0"),
        (episodes, changed(episodes, episode_index=[0, 1, 5]), "expected episode 2"),
        (episodes, changed(episodes, **{f"videos/{KEY}/file_index": [0, 1, 7]}), "file-007.mp4: not there"),
        (episodes, changed(episodes, **{f"videos/{KEY}/from_timestamp": [0, 0, 5.0]}), "ends before it"),
    ]
    for number, (path, content, sentence) in enumerate(wrong):
        for place, whole in good.items():
            place.write_bytes(whole)
        path.write_bytes(content)
        with pytest.raises(ExosightError, match=sentence):
            imported(root, tmp_path / f"data_{number}", **SENSORS)


def test_a_truncated_video_leaves_out_its_frames_if_asked(write: Write, tmp_path: Path) -> None:
    """The end of an MP4 file says what it holds, so that one is written that holds less."""
    root = write()
    video = root / "videos" / KEY / "chunk-000" / "file-001.mp4"
    video.unlink()
    write_video(video, GRAYS[LENGTHS[0] : LENGTHS[0] + LENGTHS[1] + 1])
    with pytest.raises(DataError, match=r"episode 2, frame 1: not in .*file-001\.mp4, which ends before it"):
        imported(root, tmp_path / "data", **SENSORS)
    manifest = imported(root, tmp_path / "data", resume=True, drop=True, **SENSORS)
    assert manifest.dropped["unreadable"] == LENGTHS[2] - 1

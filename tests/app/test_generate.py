"""`exosight generate`: what it prints and writes, and how it goes on."""

import json
from pathlib import Path

import pytest

from exosight.app.main import main
from exosight.dataset import read_frames

THUMB = Path(__file__).parents[2] / "examples" / "systems" / "thumb.toml"
OPTIONS = ["--system", str(THUMB), "--designs", "2", "--frames", "5"]


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """What is told of a command that is refused: one sentence."""
    with pytest.raises(SystemExit) as end:
        main(["generate", *words])
    assert end.value.code == 2
    told = capsys.readouterr().err.splitlines()
    return told[-1]


def test_counts_are_told_and_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "counts.json"
    main(["generate", "--out", str(tmp_path / "data"), *OPTIONS, "--json", str(file)])
    told, counts = capsys.readouterr().err, json.loads(file.read_text())
    kept = len(read_frames(tmp_path / "data"))
    # Every frame of both designs is kept or counted among those left out.
    assert kept + sum(counts["dropped"].values()) == 10
    assert counts["frames"] == kept > 5
    assert f"wrote {kept} frames of 2 designs" in told
    for cause, count in counts["dropped"].items():
        assert f"dropped, {cause.replace('_', ' ')}: {count}" in told


def test_zones_that_are_hardly_ever_touched_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A sleeve that is only pulled lifts off the thumb."""
    lifted, counts = tmp_path / "lifted.toml", tmp_path / "counts.json"
    text = THUMB.read_text().replace('range = ["-1 N", "4 N"]', 'range = ["-1 N", "4 N"]\ndrive = "-1 N"')
    lifted.write_text(text)
    main(["generate", "--out", str(tmp_path / "data"), *OPTIONS, "--json", str(counts)])
    told, shares = " ".join(capsys.readouterr().err.split()), json.loads(counts.read_text())["touching"]
    readings = read_frames(tmp_path / "data").sensors
    assert list(shares.values()) == pytest.approx((readings[:, :3] >= 1e-3).mean(axis=0))
    assert min(shares.values()) > 0
    assert "touched in less" not in told
    main(["generate", "--out", str(tmp_path / "none"), "--system", str(lifted), *OPTIONS[2:]])
    words = "touched in less than 1 % of the frames: P1, P2, P3; a network cannot learn"
    assert words in " ".join(capsys.readouterr().err.split())


def test_a_second_run_needs_resume_and_then_mends(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--out", str(tmp_path / "data"), *OPTIONS]
    main(["generate", *words])
    chunk = tmp_path / "data" / "chunk_0000.h5"
    content = chunk.read_bytes()
    chunk.write_bytes(content[:100])
    assert "exists already; name a new folder, or add --resume" in refused(words, capsys)
    assert chunk.read_bytes() == content[:100]
    main(["generate", *words, "--resume"])
    assert chunk.read_bytes() == content


def test_another_configuration_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--out", str(tmp_path / "data"), *OPTIONS]
    main(["generate", *words])
    assert "(seed 0 there, 5 here)" in refused([*words, "--resume", "--seed", "5"], capsys)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--workers", "0"], "--workers: input should be greater than or equal to 1, got 0"),
        (["--scheduler", "nonsense://x"], "scheduler nonsense://x: cannot be reached"),
    ],
)
def test_wrong_places_to_work_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], told: str
) -> None:
    pytest.importorskip("distributed")
    assert told in refused(["--out", str(tmp_path / "data"), *OPTIONS, *words], capsys)

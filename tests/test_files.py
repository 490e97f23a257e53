"""A file is written whole or not at all, and never over another."""

import csv
import errno
import io
import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from exosight.errors import DataError
from exosight.files import as_csv, write_new_file


def test_the_content_is_there_and_nothing_else(tmp_path: Path) -> None:
    write_new_file(tmp_path / "a", b"content")
    assert (tmp_path / "a").read_bytes() == b"content"
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_an_existing_file_is_kept(tmp_path: Path) -> None:
    write_new_file(tmp_path / "a", b"first")
    with pytest.raises(DataError, match="nothing is overwritten"):
        write_new_file(tmp_path / "a", b"second")
    assert (tmp_path / "a").read_bytes() == b"first"


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"none.*cannot be written .No such file"):
        write_new_file(tmp_path / "none" / "a", b"")


def test_a_write_that_stops_halfway_leaves_nothing(tmp_path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, hard))  # the kernel refuses the rest of the file
    try:
        with pytest.raises(DataError, match=r"cannot be written \(File too large"):
            write_new_file(tmp_path / "a", bytes(10_000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(
        DataError,
        match=r"a: cannot be written \(No space left on device, 0\.0 MB needed, .* MB free\); make room",
    ):
        write_new_file(tmp_path / "a", b"content")
    assert list(tmp_path.iterdir()) == []


def test_a_killed_process_leaves_no_visible_file(tmp_path: Path) -> None:
    program = """if True:
        import os, signal, sys
        from pathlib import Path
        from exosight.files import write_new_file
        folder = Path(sys.argv[1])
        write_new_file(folder / "first", b"kept")
        os.fsync = lambda descriptor: os.kill(os.getpid(), signal.SIGKILL)
        write_new_file(folder / "second", b"lost")
    """
    finished = subprocess.run([sys.executable, "-c", program, str(tmp_path)], timeout=120, check=False)
    assert finished.returncode == -signal.SIGKILL
    assert (tmp_path / "first").read_bytes() == b"kept"
    visible = [path.name for path in tmp_path.iterdir() if not path.name.startswith(".")]
    assert visible == ["first"]


def test_csv_keeps_what_it_is_given_and_leaves_out_what_is_no_number() -> None:
    text = as_csv(["name", "force [N]"], [["a, b", 1 / 3], ["c", float("nan")], ["d", None], ["e", 2]])
    assert list(csv.reader(io.StringIO(text))) == [
        ["name", "force [N]"],
        ["a, b", "0.333333"],
        ["c", ""],
        ["d", ""],
        ["e", "2"],
    ]

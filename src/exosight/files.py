"""Reading files of unknown origin; writing one whole or not at all; versions; CSV text."""

import csv
import errno
import io
import math
import os
import shutil
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from uuid import uuid4

from exosight.errors import DataError

FULL = (errno.ENOSPC, errno.EDQUOT)
"""Errors of a disk, or of one's share of it, that is full."""


def open_file(path: Path, expected: str) -> io.BufferedReader:
    """A regular file, opened for reading: a pipe would wait for its writer, a device may never end.

    expected   end of the sentence if there is none, such as "expected a picture"

    Raises DataError if it is missing, of another kind, or cannot be read.
    """
    try:
        file = open(path, "rb", opener=_without_waiting)  # noqa: SIM115 - the caller closes it
        if stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            return file
        file.close()
        what = "a device or a pipe"
    except FileNotFoundError:
        what = "no such file"
    except IsADirectoryError:
        what = "a folder"
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        what = error.strerror if isinstance(error, OSError) else error
    raise DataError(f"{path}: cannot be read ({what}); {expected}")


def _without_waiting(name: str, flags: int) -> int:
    return os.open(name, flags | os.O_NONBLOCK)


def read_file(path: Path, largest: int, expected: str) -> bytes:
    """The content of a regular file; DataError as `open_file`, or if it has more than `largest` bytes."""
    with open_file(path, expected) as file:
        if os.fstat(file.fileno()).st_size <= largest:  # `file.read(largest)` would take that much memory
            return file.read()
    limit = f"{largest >> 20} MiB" if largest >= 2**20 else f"{largest >> 10} KiB"
    raise DataError(f"{path}: more than {limit}; {expected}")


def write_new_file(path: Path, content: bytes) -> None:
    """Write a file that does not exist yet, on disk when this returns.

    Raises DataError if the file exists or cannot be written.
    """
    check_absent(path)
    replace_file(path, content)


@contextmanager
def new_file(path: Path) -> Iterator[Path]:
    """Where to write a large file that does not exist yet: it takes its name when it is whole, or not at all.

    Raises DataError if the file exists or cannot be written.
    """
    check_absent(path)
    try:
        with unfinished(path) as part:
            yield part
            os.replace(part, path)
    except DataError:
        raise
    except OSError as error:
        raise write_error(path, error) from error


def replace_file(path: Path, content: bytes) -> None:
    """Write a file, in the place of an older one if there is one, on disk when this returns.

    The content goes to a temporary name in the same folder, is flushed to disk and renamed; a full disk or a
    killed process leaves at most a hidden `.part` file, which nothing reads, beside what was there before.

    Raises DataError if the file cannot be written.
    """
    try:
        with unfinished(path) as part:
            with part.open("xb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            os.replace(part, path)
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)  # the new name itself
        finally:
            os.close(folder)
    except OSError as error:
        raise write_error(path, error, len(content)) from error


def check_absent(path: Path) -> None:
    """Raise DataError if there is a file of this name: none is overwritten."""
    if path.exists():
        raise DataError(f"{path}: exists already; name a new file, nothing is overwritten")


def write_error(path: Path, error: Exception, needed: int | None = None) -> DataError:
    """Why a file could not be written, as one sentence; of a full disk also what is missing.

    needed   bytes that were to be written, if that is known
    """
    text = f"{path}: cannot be written ({getattr(error, 'strerror', None) or error}"
    if getattr(error, "errno", None) not in FULL:
        return DataError(f"{text}); name a place that can be written")
    wanted = "" if needed is None else f", {needed / 1e6:.1f} MB needed"
    free = shutil.disk_usage(path.parent).free
    return DataError(
        f"{text}{wanted}, {free / 1e6:.1f} MB free); make room and run the same command again, "
        "with --resume where it has one"
    )


_PARTS: set[Path] = set()


@contextmanager
def unfinished(path: Path) -> Iterator[Path]:
    """A hidden name beside that of a file or folder, to be renamed when it is whole; else nothing is left."""
    part = path.with_name(f".{path.name}.{uuid4().hex}.part")
    _PARTS.add(part)
    try:
        yield part
    finally:
        _discard(part)
        _PARTS.discard(part)


def discard_unfinished() -> None:
    """Leave nothing of what this process has not finished, before it is ended in the middle of its work."""
    for part in list(_PARTS):
        _discard(part)


def _discard(part: Path) -> None:
    if part.is_dir():
        shutil.rmtree(part, ignore_errors=True)
    else:
        with suppress(OSError):  # where it could not be made, that is what is to be told
            part.unlink(missing_ok=True)


def check_format(path: Path, what: str, found: object, reads: int, remedy: str) -> None:
    """Raise DataError unless a file is of the one format that this version of exosight reads.

    what     kind of file, such as "checkpoint"
    found    number of its format, as it says
    reads    number of the format that is read
    remedy   how to get such a file of this format
    """
    if not isinstance(found, int) or isinstance(found, bool) or found < 1:
        raise DataError(f"{path}: not a {what} of exosight, it has no format number")
    if found != reads:
        raise DataError(
            f"{path}: {what} format {found}, this exosight reads format {reads}; {remedy}, or use the "
            "version of exosight that wrote it"
        )


def as_csv(heads: Iterable[str], rows: Iterable[Iterable[Any]], digits: int = 6) -> str:
    """Rows under their headings as CSV; floats to so many significant digits, NaN and None as nothing."""

    def cell(value: Any) -> Any:
        if not isinstance(value, float):
            return value
        return "" if math.isnan(value) else f"{value:.{digits}g}"

    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows([cell(value) for value in row] for row in rows)
    return buffer.getvalue()

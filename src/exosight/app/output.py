"""Where results go: places that must not exist yet, checked before the work and complete when they appear."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from exosight.errors import DataError, InputError
from exosight.files import FULL, unfinished, write_error


def check_new_file(path: Path) -> None:
    """Raise DataError unless a file of this name can be written without overwriting one."""
    if path.exists():
        raise DataError(f"{path}: exists already; name a new file, nothing is overwritten")
    if not path.parent.is_dir():
        raise DataError(f"{path}: {path.parent} is no folder; make it, or name a file in another one")
    try:
        with unfinished(path) as part:
            part.touch()  # permissions alone do not tell: file systems are read-only, names too long
    except OSError as error:
        raise DataError(
            f"{path}: cannot be written ({error.strerror}); name a file in another folder"
        ) from error


PLOTS = (".png", ".pdf", ".svg")
"""Endings of the files that `--plot` writes."""


def check_plot(path: Path | None) -> None:
    """Raise now if a figure cannot be written there: InputError for another ending, DataError as above."""
    if path is None:
        return
    if path.suffix not in PLOTS:
        raise InputError(
            f"--plot: expected a file {', '.join('*' + each for each in PLOTS)}, got {str(path)!r}"
        )
    check_new_file(path)


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """A folder of results that appears when it is complete: yields a hidden one beside it, to be filled.

    It is made at once, so that a place that cannot be written costs no work. If filling it fails, nothing is
    left of it.

    Raises DataError if the folder exists or cannot be made.
    """
    if path.exists():
        raise DataError(f"{path}: exists already; name a new folder, nothing is overwritten")
    with unfinished(path) as part:
        try:
            part.mkdir(parents=True)
        except OSError as error:
            raise DataError(f"{path}: cannot be made ({error.strerror}); name another folder") from error
        try:
            yield part
            part.rename(path)
        except OSError as error:
            if error.errno not in FULL:
                raise
            raise write_error(path, error) from error

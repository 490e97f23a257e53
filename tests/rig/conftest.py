"""Folders of small made-up pictures, and tables beside them."""

import csv
from collections.abc import Callable, Iterable
from pathlib import Path

import cv2
import pytest
from own_data import pictures_of, readings_of


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Twelve pictures, of which p_10 comes after p_9 though not in the alphabet."""
    place = tmp_path / "pictures"
    place.mkdir()
    for number, picture in enumerate(pictures_of(12)):
        cv2.imwrite(str(place / f"p_{number}.png"), picture)
    return place


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """Write rows as CSV: write(headings, rows, name)."""

    def call(headings: Iterable[str], rows: Iterable[Iterable[object]], name: str = "table.csv") -> Path:
        path = tmp_path / name
        with path.open("w", newline="") as file:
            csv.writer(file).writerows([headings, *rows])
        return path

    return call


@pytest.fixture
def table(write: Callable[..., Path]) -> Path:
    """A row for each of the twelve pictures, in two runs."""
    rows = [(f"p_{k}.png", "ab"[k // 6], *values) for k, values in enumerate(readings_of(12).tolist())]
    return write(("picture", "run", "thumb [mN]", "palm [N]"), rows)

"""The loss curves of a run: one record an epoch, and the CSV file that holds them."""

import csv
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import pydantic

from exosight.errors import DataError
from exosight.files import read_file, replace_file

HISTORY_NAME = "history.csv"
_LARGEST = 2**24  # bytes; an epoch takes a hundred


@dataclass(frozen=True)
class EpochRecord:
    """One epoch; the two validation columns are empty where the recipe did not validate."""

    epoch: int
    """from 1"""
    step: int
    """optimiser steps since the start"""
    learning_rate: float
    """of the epoch's last step"""
    train_loss: float
    """the recipe's loss of the outputs [-], mean over the epoch while the weights moved"""
    validation_loss: float | None
    """the same measure on the validation part [-]"""
    validation_l1: float | None
    """mean absolute error over the outputs on the validation part [their unit]"""
    seconds: float
    """time spent training since the start [s]"""

    def curves(self) -> dict[str, float]:
        """What is drawn over the steps: name → value, in the letters that TensorBoard takes."""
        found = {
            "learning_rate": self.learning_rate,
            "loss/training": self.train_loss,
            "loss/validation": self.validation_loss,
            "mean_error": self.validation_l1,
        }
        return {name: value for name, value in found.items() if value is not None}


_COLUMNS = [field.name for field in fields(EpochRecord)]
_HISTORY = pydantic.TypeAdapter(tuple[EpochRecord, ...], config=pydantic.ConfigDict(allow_inf_nan=False))


def write_history(folder: Path, history: Iterable[EpochRecord]) -> None:
    """Write `history.csv` into the folder, whole or not at all; numbers keep all their digits."""
    rows = [",".join(_COLUMNS)]
    for record in history:
        rows.append(",".join("" if value is None else repr(value) for value in asdict(record).values()))
    replace_file(folder / HISTORY_NAME, ("\n".join(rows) + "\n").encode())


def read_history(folder: Path) -> tuple[EpochRecord, ...]:
    """Read back what `write_history` wrote.

    Raises DataError if the file is missing or is not such a table.
    """
    path = folder / HISTORY_NAME
    content = read_file(path, _LARGEST, "expected a run's folder")
    try:
        rows = list(csv.DictReader(content.decode().splitlines()))
    except (ValueError, csv.Error) as error:
        raise DataError(f"{path}: not a table of text") from error
    try:
        return _HISTORY.validate_python([{key: cell or None for key, cell in row.items()} for row in rows])
    except pydantic.ValidationError as error:
        raise DataError(f"{path}: not a training history with the columns {', '.join(_COLUMNS)}") from error

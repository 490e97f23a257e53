"""Networks' files: cards and graphs changed, the checksum mended."""

import random
from pathlib import Path

from closed_form import closed_form, write
from model_mutations import mutate, outcome

from exosight.errors import DataError


class Model:
    """Networks: opened, and run if they are accepted."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / "model.onnx"
        write(self._path, closed_form())
        self._valid = self._path.read_bytes()

    def __call__(self, draw: random.Random) -> None:
        """One network."""
        self._path.write_bytes(mutate(self._valid, draw))
        if outcome(self._path) == "refused":
            raise DataError("refused")

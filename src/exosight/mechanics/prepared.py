"""What is computed of robots before they are solved, kept for the next solve of the same ones."""

from threading import Lock
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from exosight.mechanics.compiled_lanes import Common, Compiled, Rows, compiled, leaves_of
from exosight.mechanics.known_numbers import known_numbers
from exosight.mechanics.path_step import program_of

MOST = 256
"""Robots that are prepared at once, and kept: some 12 MiB. Of more each is prepared when its turn comes."""

KEPT = 4
"""Batches."""


class Settings(NamedTuple):
    """What robots are prepared for: lanes, loads that a lane takes at a time, programs or XLA."""

    lanes: int
    room: int
    unrolled: bool


class Prepared:
    """Robots that have something in common, ready to be put into lanes.

    arrays   (robots, numbers)  all arrays of each
    """

    def __init__(
        self, common: Common, settings: Settings, arrays: Float[np.ndarray, "robots numbers"]
    ) -> None:
        self.common, self.settings, self.arrays = common, settings, arrays
        shapes = tuple(shape for shape, _ in common.kinds)
        known = known_numbers(common.structure, list(map(np.asarray, leaves_of(common.kinds, arrays))))
        program = program_of(common.structure, shapes, common.channels, known) if settings.unrolled else None
        self.code: Compiled = compiled(common, program, settings.room)
        self._rows = self._prepared(arrays) if len(arrays) <= MOST else None

    def rows(self, numbers: Int[np.ndarray, " some"]) -> Rows:
        """Some of the robots."""
        return self._prepared(self.arrays[numbers]) if self._rows is None else self._rows[numbers]

    def _prepared(self, arrays: Float[np.ndarray, "some numbers"]) -> Rows:
        together = self.settings.lanes
        rows = [np.zeros((0, self.code.layout.robots.numbers))]
        for first in range(0, len(arrays), together):
            own = arrays[first : first + together]
            filled = own[np.minimum(np.arange(together), len(own) - 1)]  # compiled for so many
            rows.append(np.asarray(self.code.prepare(filled))[: len(own)])
        return np.concatenate(rows)


_LOCK = Lock()
_RECENT: list[Prepared] = []


def prepared(common: Common, settings: Settings, arrays: Float[np.ndarray, "robots numbers"]) -> Prepared:
    """The robots of these arrays, as an earlier solve prepared them if these were the same numbers."""
    with _LOCK:
        for at, kept in enumerate(_RECENT):
            alike = kept.settings == settings and kept.common == common
            if alike and np.array_equal(kept.arrays.view(np.int64), arrays.view(np.int64)):
                _RECENT.insert(0, _RECENT.pop(at))
                return kept
    found = Prepared(common, settings, arrays)
    if len(arrays) <= MOST:
        with _LOCK:
            _RECENT.insert(0, found)
            del _RECENT[KEPT:]
    return found

"""The processes that train one network together; usable without PyTorch."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Integer


@dataclass(frozen=True)
class ProcessGroup:
    """This process among those of its run, see `exosight.learning.parallel`."""

    rank: int = 0
    """its number, from 0"""
    size: int = 1
    """how many they are"""
    local_size: int = 1
    """how many of them share this machine, itself included"""
    device: Literal["cpu", "cuda"] = "cpu"
    """what their messages are sent from"""

    @property
    def first(self) -> bool:
        """Whether it is the one that writes and reports."""
        return self.rank == 0

    def part(self, batch: Integer[np.ndarray, " n"]) -> Integer[np.ndarray, " part"]:
        """Its slice of a batch; slices are equal to within one image."""
        return np.array_split(batch, self.size)[self.rank]


SINGLE = ProcessGroup()

"""What a transform is, what it draws from, and what it changes."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float64, UInt8

from exosight.vision.appearance import AppearanceVariation
from exosight.vision.counter_rng import pick
from exosight.vision.pixel_loops import compose
from exosight.vision.renderer import BACKGROUND

Picture = UInt8[np.ndarray, "height width"]
Column = Float64[np.ndarray, " frames"]
Row = Mapping[str, float]
TURN = 2 * np.pi


class Transform(ABC):
    """One thing that may become of a picture."""

    columns: ClassVar[Mapping[str, float]]
    """Its numbers by name, each with the value that does nothing."""
    switches: ClassVar[tuple[str, ...]]
    """Those of its columns by which it acts: on frames where one of them differs from that value."""
    separates: ClassVar[bool] = False
    """Whether it must tell the bodies from what is behind them."""

    @abstractmethod
    def draw(self, limits: AppearanceVariation, draws: "Draws") -> dict[str, Column]:
        """Its columns for some frames."""

    @abstractmethod
    def apply(self, canvas: "Canvas", row: Row) -> None:
        """Change the canvas of a frame with these numbers, on which it acts."""

    def acts(self, row: Row) -> bool:
        """Whether it changes a frame with these numbers."""
        return any(row[name] != self.columns[name] for name in self.switches)


@dataclass(frozen=True)
class Draws:
    """Random numbers of frames for every column: one for its value, one for whether its switch acts."""

    names: Sequence[str]
    values: Float64[np.ndarray, "frames columns"]
    switches: Float64[np.ndarray, "frames columns"]
    acting: float
    """Share of the frames that a switch acts on."""

    def share(self, name: str) -> Column:
        """Even in [0, 1)."""
        return self.values[:, self.names.index(name)]

    def acts(self, switch: str) -> Column:
        """1 where a switch acts, 0 elsewhere; a switch goes by the name of its first column."""
        return (self.switches[:, self.names.index(switch)] < self.acting).astype(float)

    def up_to(self, name: str, largest: float) -> Column:
        """Even in [0, largest) where the switch acts."""
        return self.acts(name) * largest * self.share(name)

    def either_way(self, name: str, largest: float, switch: str | None = None) -> Column:
        """Even in [−largest, largest) where the switch acts."""
        return self.acts(switch or name) * largest * (2 * self.share(name) - 1)

    def count(self, name: str, most: int) -> Column:
        """Whole numbers 0…most where the switch acts."""
        return self.acts(name) * np.floor(self.share(name) * (most + 1))

    def kind(self, name: str, chosen: Sequence[str], known: Sequence[str]) -> Column:
        """Place among the known kinds, from 1, of one of those chosen where the switch acts."""
        places = [1 + known.index(each) for each in chosen] or [0]
        return self.acts(name) * pick(self.share(name), places)


@dataclass
class Canvas:
    """A picture in the making."""

    bodies: Picture
    """Before the renderer's background."""
    cover: Picture | None
    """How much of each pixel the bodies cover, 0…255; None: not known, and not needed."""
    homography: Float64[np.ndarray, "3 3"]
    """Of the frame's view, see `exosight.vision.view.homographies`."""
    seed: int
    """Of what is random beyond the frame's columns."""
    dark: float = 0.0
    """What black becomes on the bodies."""
    contrast: float = 1.0
    """Range of grays that the bodies keep."""
    behind: Picture | None = None
    """What is behind the bodies; None: the renderer's background."""
    finished: Picture | None = None
    """The picture so far, once the bodies are before what is behind them."""

    def own(self, purpose: int) -> int:
        """A seed for one purpose of the frame."""
        return self.seed + (purpose << 32)

    def behind_bodies(self) -> Picture:
        """What is behind the bodies, to draw on."""
        if self.behind is None:
            self.behind = np.full_like(self.bodies, BACKGROUND)
        return self.behind

    @property
    def picture(self) -> Picture:
        """The picture so far; from here on the scene is fixed."""
        if self.finished is None:
            self.finished = self.bodies
            if self.behind is not None or self.contrast != 1.0:
                assert self.cover is not None
                self.finished = np.empty_like(self.bodies)
                compose(
                    self.bodies, self.cover, self.behind_bodies(), self.dark, self.contrast, self.finished
                )
        return self.finished

    @picture.setter
    def picture(self, value: Picture) -> None:
        self.finished = value

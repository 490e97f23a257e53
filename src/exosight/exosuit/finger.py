"""The finger: three hinged links and a fingertip, with two contact spheres on each.

Dimensions and stiffness: the paper's Table I and §1 of its methods (Kuo et al. 2012; Shi et al. 2020).
"""

from dataclasses import dataclass

import numpy as np

from exosight.errors import InputError
from exosight.mechanics import Link, Revolute

JOINT_LIMIT_STIFFNESS = 5.0
"""Quadratic penalty beyond a joint's range [N m/rad]; not printed in the paper."""


@dataclass(frozen=True)
class Finger:
    """A finger along x, hinged about y; positive joint angles flex it towards −z.

    lengths          (links,)      [m]
    radii            (links + 1,)  at the base of each link and at the tip [m]; tapered in between
    joint_stiffness  (hinges,)     [N m/rad]; links after the last hinge are fixed to it
    joint_range      (hinges,)     (lower, upper) [rad]
    """

    lengths: tuple[float, ...] = (0.045, 0.0253, 0.0236, 0.001)
    radii: tuple[float, ...] = (0.0108, 0.00695, 0.0051, 0.00435, 0.004)
    joint_stiffness: tuple[float, ...] = (0.04, 0.03, 0.02)
    joint_range: tuple[tuple[float, float], ...] = tuple(
        (float(np.deg2rad(low)), float(np.deg2rad(90.0))) for low in (-10.0, -5.0, -5.0)
    )

    def __post_init__(self) -> None:
        if len(self.radii) != len(self.lengths) + 1:
            raise InputError(
                f"finger radii: expected one more than links, {len(self.lengths) + 1}, got {len(self.radii)}"
            )
        if not len(self.joint_stiffness) == len(self.joint_range) <= len(self.lengths):
            raise InputError(
                "finger joints: expected one stiffness and one range a hinge; at most a hinge a link; got "
                f"{len(self.joint_stiffness)}, {len(self.joint_range)} and {len(self.lengths)} links"
            )
        for name, values in (("lengths", self.lengths), ("radii", self.radii)):
            if not all(np.isfinite(v) and v > 0 for v in values):
                raise InputError(f"finger {name}: expected finite numbers above 0 m, got {values}")

    def centre_of_mass(self, link: int) -> float:
        """Distance [m] of the centre of mass of the tapered solid `link` from its base."""
        a, b = self.radii[link], self.radii[link + 1]
        return self.lengths[link] * (a * a + 2 * a * b + 3 * b * b) / (4 * (a * a + a * b + b * b))

    def sphere_places(self) -> tuple[float, ...]:
        """Distance [m] of each contact sphere along the finger: at each link's base and centre of mass."""
        places, start = [], 0.0
        for i, length in enumerate(self.lengths):
            places += [start, start + self.centre_of_mass(i)]
            start += length
        return tuple(places)

    def sphere_radii(self) -> tuple[float, ...]:
        """Radius [m] of each contact sphere: the link's local radius."""
        radii = []
        for i, length in enumerate(self.lengths):
            a, b = self.radii[i], self.radii[i + 1]
            radii += [a, a + (b - a) * self.centre_of_mass(i) / length]
        return tuple(radii)

    def links(self) -> tuple[Link, ...]:
        """The links, each with two sites: base and centre of mass."""
        links = []
        for i, length in enumerate(self.lengths):
            hinge = (
                Revolute(
                    stiffness=self.joint_stiffness[i],
                    limits=self.joint_range[i],
                    limit_stiffness=JOINT_LIMIT_STIFFNESS,
                )
                if i < len(self.joint_stiffness)
                else None
            )
            links.append(
                Link(
                    self.link_name(i),
                    length,
                    np.array([[0.0, 0.0, 0.0], [self.centre_of_mass(i), 0.0, 0.0]]),
                    parent=self.link_name(i - 1) if i else None,
                    joint=hinge,
                )
            )
        return tuple(links)

    @staticmethod
    def link_name(link: int) -> str:
        """Name of the body of link 0, 1, … in the robot."""
        return f"finger_{link}"

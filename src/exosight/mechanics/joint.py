"""Joints: relative motion of a body and its parent.

A joint moves by exp(A₁ q₁) exp(A₂ q₂) …, the columns of A_k being constant twists and q₁, q₂ … its own
coordinates in order. Most need one exponential; a universal joint is two hinges in series.
A new joint is a class whose constructor lists its twists.
"""

from collections.abc import Sequence
from typing import TypedDict, Unpack

import equinox as eqx
import numpy as np
from jaxtyping import Float

from exosight.errors import InputError

Axis = tuple[float, float, float]
Limits = tuple[float, float] | Sequence[tuple[float, float]]
PerCoordinate = float | Sequence[float]

X: Axis = (1.0, 0.0, 0.0)
Y: Axis = (0.0, 1.0, 0.0)
Z: Axis = (0.0, 0.0, 1.0)


class Springs(TypedDict, total=False):
    """Options of every joint besides its axes; the fields of `Joint`."""

    stiffness: PerCoordinate
    damping: PerCoordinate
    limits: Limits
    limit_stiffness: PerCoordinate


class Joint(eqx.Module):
    """A joint with constant twists, springs, dampers and a range.

    Values are one for all coordinates or one per coordinate; units by coordinate, rad for rotations,
    m for translations.

    twists            groups of twists, one exponential per group, one twist per coordinate (static)
    stiffness         (dofs,)     spring about q = 0 [N m/rad or N/m]
    damping           (dofs,)     [N m s/rad or N s/m]
    lower, upper      (dofs,)     range [rad or m]; ±inf where there is none
    limit_stiffness   (dofs,)     quadratic penalty beyond the range [N m/rad or N/m]
    """

    twists: tuple[tuple[tuple[float, ...], ...], ...] = eqx.field(static=True)
    stiffness: Float[np.ndarray, " dofs"]
    damping: Float[np.ndarray, " dofs"]
    lower: Float[np.ndarray, " dofs"]
    upper: Float[np.ndarray, " dofs"]
    limit_stiffness: Float[np.ndarray, " dofs"]

    def __init__(
        self,
        twists: Sequence[Sequence[Sequence[float]]],
        stiffness: PerCoordinate = 0.0,
        limits: Limits = (-np.inf, np.inf),
        limit_stiffness: PerCoordinate = 0.0,
        damping: PerCoordinate = 0.0,
    ) -> None:
        """Raises InputError for invalid or linearly dependent twists, a negative or
        infinite number, an empty range, or a wrong count.
        """
        name = type(self).__name__
        self.twists = tuple(tuple(tuple(map(float, twist)) for twist in group) for group in twists)
        for group in self.twists:
            if any(len(twist) != 6 or not np.all(np.isfinite(twist)) for twist in group):
                raise InputError(
                    f"{name} twists: expected six finite numbers each, angular first, got {group}"
                )
            if np.linalg.matrix_rank(np.array(group)) < len(group):
                raise InputError(f"{name} twists: expected directions that differ in a group, got {group}")
        for what, value in (
            ("stiffness", stiffness),
            ("damping", damping),
            ("limit_stiffness", limit_stiffness),
        ):
            numbers = np.asarray(value, dtype=float)
            if numbers.ndim and numbers.shape != (self.dofs,):
                raise InputError(f"{name} {what}: expected one number or {self.dofs}, got {numbers.shape}")
            if not (np.all(numbers >= 0) and np.all(np.isfinite(numbers))):
                raise InputError(f"{name} {what}: expected finite numbers of at least 0, got {value}")
            setattr(self, what, np.broadcast_to(numbers, self.dofs).copy())
        ranges = np.asarray(limits, dtype=float)
        if ranges.shape not in ((2,), (self.dofs, 2)) or not np.all(ranges[..., 0] < ranges[..., 1]):
            raise InputError(
                f"{name} limits: expected lower < upper, one pair or {self.dofs} of them, got {limits}"
            )
        ranges = np.broadcast_to(ranges, (self.dofs, 2))
        held = np.broadcast_to(np.asarray(limit_stiffness, dtype=float), self.dofs) > 0
        if np.any(np.isfinite(ranges).any(axis=1) & ~held):
            raise InputError(
                f"{name} limits: a range without limit_stiffness holds nothing back; give it above 0 N m/rad "
                "or N/m"
            )
        self.lower, self.upper = ranges[:, 0].copy(), ranges[:, 1].copy()

    @property
    def dofs(self) -> int:
        """Number of coordinates."""
        return sum(len(group) for group in self.twists)

    @property
    def groups(self) -> list[Float[np.ndarray, "6 group"]]:
        """The twists of each exponential, as columns."""
        return [np.array(group).T for group in self.twists]


class Fixed(Joint):
    """No motion: the body is clamped to its parent."""

    def __init__(self) -> None:
        super().__init__(())


class Revolute(Joint):
    """A hinge: rotation about `axis` through its origin [rad]; (0, 1, 0) flexes a finger in the x–z plane."""

    def __init__(self, axis: Axis = Y, **springs: Unpack[Springs]) -> None:
        super().__init__([[_turn(axis)]], **springs)


class Prismatic(Joint):
    """Translation along `axis` [m]."""

    def __init__(self, axis: Axis = X, **springs: Unpack[Springs]) -> None:
        super().__init__([[_slide(axis)]], **springs)


class Helical(Joint):
    """A screw: rotation about `axis` [rad] and translation along it by `pitch` per radian [m/rad]."""

    def __init__(
        self,
        axis: Axis = X,
        pitch: float = 0.001,
        **springs: Unpack[Springs],
    ) -> None:
        if not np.isfinite(pitch):
            raise InputError(f"Helical pitch: expected a finite number of m/rad, got {pitch}")
        twist = np.add(_turn(axis), pitch * np.array(_slide(axis))).tolist()
        super().__init__([[twist]], **springs)


class Cylindrical(Joint):
    """Rotation about `axis` [rad] and translation along it [m]."""

    def __init__(self, axis: Axis = X, **springs: Unpack[Springs]) -> None:
        super().__init__([[_turn(axis), _slide(axis)]], **springs)


class Planar(Joint):
    """Rotation about `normal` [rad] and translation across it in two directions [m], in one exponential.

    Singular at a full turn. The directions are the two of the joint's axes after
    the normal's largest component, made square to it: z and x for the normal y.
    """

    def __init__(self, normal: Axis = Y, **springs: Unpack[Springs]) -> None:
        turn = _turn(normal)
        n = np.array(normal)
        first = np.eye(3)[(int(np.argmax(np.abs(n))) + 1) % 3]
        first = (first - n * (n @ first)) / np.linalg.norm(first - n * (n @ first))
        across = [[0.0, 0.0, 0.0, *direction] for direction in (first, np.cross(n, first))]
        super().__init__([[turn, *across]], **springs)


class Spherical(Joint):
    """A ball joint; its coordinates are the rotation vector [rad], singular at a full turn."""

    def __init__(self, **springs: Unpack[Springs]) -> None:
        super().__init__([[_turn(a) for a in (X, Y, Z)]], **springs)


class Universal(Joint):
    """Two hinges through one point, about `first` in the parent and then about `second` [rad]."""

    def __init__(
        self,
        first: Axis = Y,
        second: Axis = Z,
        **springs: Unpack[Springs],
    ) -> None:
        hinges = [[_turn(first)], [_turn(second)]]
        if abs(np.dot(first, second)) > 1 - 1e-9:
            raise InputError(f"Universal axes: expected two directions, got {first} and {second}")
        super().__init__(hinges, **springs)


class Free(Joint):
    """Rotation vector [rad] and translation [m] of one exponential, singular at a full turn."""

    def __init__(self, **springs: Unpack[Springs]) -> None:
        super().__init__([np.eye(6).tolist()], **springs)


def _unit(axis: Axis) -> Axis:
    if len(axis) != 3 or not np.isclose(np.linalg.norm(axis), 1.0):
        raise InputError(f"joint axis: expected a unit vector, got {axis}; divide it by its length")
    return axis


def _turn(axis: Axis) -> list[float]:
    return [*_unit(axis), 0.0, 0.0, 0.0]


def _slide(axis: Axis) -> list[float]:
    return [0.0, 0.0, 0.0, *_unit(axis)]

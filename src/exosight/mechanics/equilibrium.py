"""Stable equilibria, local minima of the potential energy: what is asked of a solver, and what it found."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from exosight.arrays import AnyArray
from exosight.errors import InputError
from exosight.mechanics.robot import Robot
from exosight.mechanics.term import Memories


@dataclass(frozen=True)
class SolverOptions:
    """How an equilibrium is searched.

    tolerance       largest residual of a converged point [-], see `Equilibria`
    max_iterations  evaluations of the energy on the way to one load before it is given up, snaps included
    lanes           robots solved side by side in one compiled call; by default 8 on a CPU, where they share
                    the cache of a core, and 2048 on a GPU
    unrolled        evaluate by scalar programs where that can be done (on CPUs), else by XLA: several times
                    as fast, and the same up to round-off
    eigenvalues     find `min_eigenvalue`; otherwise it is NaN for robots whose forces all have an energy, of
                    which a Cholesky factor tells that a pose is stable
    """

    tolerance: float = 1e-10
    max_iterations: int = 5000
    lanes: int | None = None
    unrolled: bool = True
    eigenvalues: bool = True

    def __post_init__(self) -> None:
        if not (self.tolerance > 0 and self.max_iterations > 0 and (self.lanes is None or self.lanes > 0)):
            raise InputError(f"solver: expected tolerance, max_iterations and lanes above 0, got {self}")


class Equilibria(NamedTuple):
    """Equilibria along a path; every field may carry leading batch dimensions.

    q               (loads, dofs)   coordinates
    converged       (loads,)        residual within tolerance and stable
    residual        (loads,)        |∇Π| / (|q| + q₀): relative error in the elastic energy norm [-];
                                    |∇Π|² = ∇Πᵀ M⁻¹ ∇Π, |q|² = qᵀ M q, q₀ = |q| of a strain or angle of 0.01
    min_eigenvalue  (loads,)        smallest λ of ∇²Π v = λ M v [-]: 1 at rest, 0 where the pose snaps; with
                                    forces that have no energy, the smallest real part; NaN where it was not
                                    asked for, see `SolverOptions`
    snapped         (loads,)        the pose jumped on the way from the load before
    tied            (loads,)        a descent on the way came to rest at a saddle: which side it left to is a
                                    matter of round-off
    energy          (loads,)        Π [J]
    supplied        (loads,)        what changing loads gave since the start of the path, ∫ ∂Π/∂u · du [J]
    dissipated      (loads,)        what friction, relaxation and snaps took since then [J]
    iterations      (loads,)        evaluations of the energy on the way from the load before
    history         (loads, ...)    what each term with a memory remembers there, see `TermWithMemory`
    """

    q: Float[AnyArray, "*batch loads dofs"]
    converged: Bool[AnyArray, "*batch loads"]
    residual: Float[AnyArray, "*batch loads"]
    min_eigenvalue: Float[AnyArray, "*batch loads"]
    snapped: Bool[AnyArray, "*batch loads"]
    tied: Bool[AnyArray, "*batch loads"]
    energy: Float[AnyArray, "*batch loads"]
    supplied: Float[AnyArray, "*batch loads"]
    dissipated: Float[AnyArray, "*batch loads"]
    iterations: Int[AnyArray, "*batch loads"]
    history: Memories = ()


def stack(robots: Sequence[Robot]) -> Robot:
    """Robots of one structure as a single batched robot: every number gains a leading axis."""
    return jax.tree.map(lambda *leaves: np.stack(leaves), *robots)

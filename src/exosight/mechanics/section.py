"""The cross-section of a rod: the one place that turns E, ν, ρ and a radius into stiffness and mass."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

Scalar = Float[Array, ""]


def circular_stiffness(
    radius: Float[Array, " points"], young: Scalar, poisson: Scalar
) -> Float[Array, "points 6"]:
    """Diagonal of Σ in wrench = Σ (ξ − ξ*): (G·2I, E·I, E·I, E·A, G·A, G·A) with G = E / 2(1 + ν).

    radius    (points,)     [m]
    young     ()            [Pa]
    poisson   ()            [-]
    returns   (points, 6)   torsion and bending [N m²], then stretch and shear [N]

    Shear carries no correction factor, as in the paper's toolbox.
    Source: Mathew et al., SoRoSim, doi 10.1109/MRA.2022.3202488.
    """
    area = np.pi * radius**2
    moment = area * radius**2 / 4
    shear = young / (2 * (1 + poisson))
    return jnp.stack(
        [2 * shear * moment, young * moment, young * moment, young * area, shear * area, shear * area],
        axis=-1,
    )


def circular_mass(radius: Float[Array, " points"], density: Scalar) -> Float[Array, " points"]:
    """Mass per length ρA [kg/m] of a disc of `radius` [m] and `density` [kg/m³]."""
    return density * np.pi * radius**2

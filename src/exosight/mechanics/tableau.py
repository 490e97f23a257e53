"""Coefficients of a Runge–Kutta method that is implicit in one stage at a time.

For dy/dt = f(y) and a step h, the stages Y_i and the solution at the end of the step are

    Y_i = y_n + h Σ_{j<i} a_ij f(Y_j) + h γ f(Y_i),      y_{n+1} = y_n + h Σ_i b_i f(Y_i).

In an ESDIRK method the first stage is explicit (Y_0 = y_n), all others share one γ, and the method is
stiffly accurate: the last row of coefficients is b, so y_{n+1} = Y_last and f(Y_last) is the next f(Y_0).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Tableau:
    """An ESDIRK method with an embedded solution of one order less.

    lower      (stages, stages)   a_ij below the diagonal, zero elsewhere
    diagonal                      γ of every stage but the first
    nodes      (stages,)          c_i: stage i is at the time t_n + c_i h
    embedded   (stages,)          b̂_i of the embedded solution
    order                         of the solution
    """

    lower: Float[np.ndarray, "stages stages"]
    diagonal: float
    nodes: Float[np.ndarray, " stages"]
    embedded: Float[np.ndarray, " stages"]
    order: int

    @property
    def stages(self) -> int:
        """Number of stages, the explicit one included."""
        return len(self.nodes)

    @property
    def weights(self) -> Float[np.ndarray, " stages"]:
        """b_i, the last stage's coefficients."""
        return np.append(self.lower[-1, :-1], self.diagonal)

    @property
    def error_weights(self) -> Float[np.ndarray, " stages"]:
        """b_i − b̂_i: h Σ_i (b_i − b̂_i) f(Y_i) estimates the error of a step."""
        return self.weights - self.embedded


def _ark4_implicit() -> Tableau:
    lower = np.zeros((6, 6))
    lower[1, :1] = 1 / 4
    lower[2, :2] = 8611 / 62500, -1743 / 31250
    lower[3, :3] = 5012029 / 34652500, -654441 / 2922500, 174375 / 388108
    lower[4, :4] = 15267082809 / 155376265600, -71443401 / 120774400, 730878875 / 902184768, 2285395 / 8070912
    lower[5, :5] = 82889 / 524892, 0.0, 15625 / 83664, 69875 / 102672, -2260 / 8211
    embedded = [
        4586570599 / 29645900160,
        0.0,
        178811875 / 945068544,
        814220225 / 1159782912,
        -3700637 / 11593932,
        61727 / 225920,
    ]
    return Tableau(
        lower=lower,
        diagonal=1 / 4,
        nodes=np.array([0.0, 1 / 2, 83 / 250, 31 / 50, 17 / 20, 1.0]),
        embedded=np.array(embedded),
        order=4,
    )


ARK4_IMPLICIT = _ark4_implicit()
"""The implicit half of ARK4(3)6L[2]SA: order 4, embedded order 3, L-stable, stage order 2.

Source: C. A. Kennedy, M. H. Carpenter, Additive Runge–Kutta schemes for convection–diffusion–reaction
equations, Applied Numerical Mathematics 44, 2003, doi 10.1016/S0168-9274(02)00138-1.
"""

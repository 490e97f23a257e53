"""The array type of data that passes between compiled code and NumPy.

Importing this module switches JAX to float64: equilibria are solved to 1e-9 relative, which single precision
cannot represent.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

jax.config.update("jax_enable_x64", True)

AnyArray = jax.Array | np.ndarray
"""An array of JAX or of NumPy: results are read with either, and constructors take either."""

Number = float | AnyArray
"""A single number; an array without dimensions where JAX is to differentiate by it."""


def known(value: Any) -> bool:
    """Whether a number can be looked at: while JAX differentiates or compiles, its value is still open."""
    return not isinstance(value, Tracer)


def floats(value: Any) -> AnyArray:
    """Numbers as an array of floats: one of JAX as it is, anything else copied into one of NumPy.

    Robots keep their numbers so. Compiled code takes both, and making fifty arrays of JAX takes 5 ms.
    """
    return jnp.asarray(value, dtype=float) if isinstance(value, jax.Array) else np.array(value, dtype=float)

"""The array type of data that passes between compiled code and NumPy."""

import jax
import numpy as np

AnyArray = jax.Array | np.ndarray
"""An array of JAX or of NumPy: results are read with either, and constructors take either."""

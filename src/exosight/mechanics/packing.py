"""Trees of arrays as rows of numbers.

Every array that goes into compiled code or comes out of it costs a microsecond or two, whatever its size; the
state of a robot on its way is sixty arrays.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from exosight.arrays import AnyArray


class Packing:
    """Where the arrays of a tree, whose values are floats, small whole numbers or truth values, are in a row.

    example   a tree of such arrays (or of their shapes and types)
    numbers   length of a row
    """

    def __init__(self, example: Any) -> None:
        leaves, self._structure = jax.tree.flatten(example)
        ends = np.cumsum([0, *(int(np.prod(np.shape(leaf))) for leaf in leaves)]).tolist()
        self.numbers = ends[-1]
        self._places = [
            (slice(start, end), np.shape(leaf), None if leaf.dtype == float else leaf.dtype)
            for start, end, leaf in zip(ends[:-1], ends[1:], leaves, strict=True)
        ]

    def pack(self, tree: Any) -> Float[AnyArray, " numbers"]:
        """A tree as a row: of NumPy if all of its arrays are, as every function of JAX compiles something."""
        leaves = jax.tree.leaves(tree)
        xp: Any = np if all(isinstance(leaf, np.ndarray) for leaf in leaves) else jnp
        return xp.concatenate([xp.reshape(leaf, -1).astype(float) for leaf in leaves])

    def unpack(self, rows: Float[AnyArray, "*batch numbers"]) -> Any:
        """The trees of some rows, of arrays with leading axes; floats of NumPy are views of the rows."""
        kinds = (kind for _, _, kind in self._places)
        parts = zip(self._parts(rows), kinds, strict=True)
        leaves = [part if kind is None else part.astype(kind) for part, kind in parts]
        return jax.tree.unflatten(self._structure, leaves)

    def views(self, rows: Float[np.ndarray, "*batch numbers"]) -> Any:
        """The same to be written to: all are views of the rows, whole numbers and truth values as floats."""
        return jax.tree.unflatten(self._structure, self._parts(rows))

    def _parts(self, rows: Float[AnyArray, "*batch numbers"]) -> list[AnyArray]:
        return [rows[..., where].reshape(*rows.shape[:-1], *shape) for where, shape, _ in self._places]

"""JAX functions as programs of operations on single numbers, run over eight samples at once on a CPU.

The function itself stays the only source: its jaxpr is unrolled (`tracing`) to a graph of scalar operations
(`graph`), in which moved data, zeros and numbers known beforehand are gone; the rest becomes a program
(`program`) for a small interpreter (`interpreter`).
"""

from exosight.scalar_program.function import Held, Unrolled, call_unrolled, unroll
from exosight.scalar_program.graph import Unsupported
from exosight.scalar_program.interpreter import obstacle

__all__ = ["Held", "Unrolled", "Unsupported", "call_unrolled", "obstacle", "unroll"]

"""What is recorded of a robot on its quasi-static path: at each load, and at each snap."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from exosight.arrays import AnyArray
from exosight.mechanics.acceptance import Point
from exosight.mechanics.continuation_state import ContinuationState, OfLoad, OfSnap


class Entry(NamedTuple):
    """What is to be recorded: at the load that was aimed at if `done`, and of a snap if `jumped`."""

    done: Bool[AnyArray, ""]
    jumped: Bool[AnyArray, ""]
    of_load: OfLoad
    of_snap: OfSnap


def entry_of(
    state: ContinuationState,
    point: Point,
    at_load: AnyArray,
    done: AnyArray,
    reached: AnyArray,
    jumped: AnyArray,
    snap_load: AnyArray,
    released: AnyArray,
    taken: AnyArray,
) -> Entry:
    """What to record where the load is `done`, and of a snap at `snap_load` if the pose has `jumped`.

    released  Π at `snap_load` of the anchor, less that of the point [J]
    taken     what terms with a memory have dissipated since the anchor [J]
    """
    of_load = OfLoad(
        q=jnp.where(at_load, point.q, state.anchor.q),
        energy=point.here.energy,
        supplied=state.supplied,
        dissipated=state.dissipated,
        residual=point.residual,
        iterations=state.steps,
        converged=at_load,
        snapped=state.snapped,
        tied=state.tied,
        load=reached,
        memories=jax.tree.map(
            lambda new, old: jnp.where(at_load, new, old), state.memories, state.anchor.memories
        ),
    )
    of_snap = OfSnap(state.load, snap_load, state.anchor.q, point.q, released, taken)
    return Entry(done, jumped, of_load, of_snap)


class Records(NamedTuple):
    """Rows of `OfLoad`, each with ∂∇Π/∂q there, and of `OfSnap`, see `Packing`.

    A last row of both holds what is not wanted: without a choice whether to write, nothing has to be read.
    """

    loads: Float[AnyArray, "*robots loads+1 numbers"]
    snaps: Float[AnyArray, "*robots snaps+1 numbers"]


def put(
    rows: Float[AnyArray, "places numbers"],
    at: Int[AnyArray, ""],
    wanted: Bool[AnyArray, ""],
    *values: Float[AnyArray, " _"],
) -> Float[Array, "places numbers"]:
    """The rows with values, one after the other, in one of them; in the last if they are not wanted."""
    at = jnp.where(wanted, at, len(rows) - 1)
    return jax.lax.dynamic_update_index_in_dim(rows, jnp.concatenate(values), at, 0)

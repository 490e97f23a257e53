"""What is recorded of a robot on its quasi-static path: at each load, and at each snap."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from exosight.arrays import AnyArray
from exosight.mechanics.acceptance import Point
from exosight.mechanics.continuation_state import SNAPS, ContinuationState, Records


class Entry(NamedTuple):
    """What is to be recorded: at load `load` if `done`, and a snap on the way to it if `jumped`."""

    load: Int[AnyArray, ""]
    snap: Int[AnyArray, ""]
    done: Bool[AnyArray, ""]
    jumped: Bool[AnyArray, ""]
    of_load: dict[str, Any]
    of_snap: dict[str, Any]


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
    of_load = {
        "q": jnp.where(at_load, point.q, state.anchor.q),
        "energy": point.here.energy,
        "supplied": state.supplied,
        "dissipated": state.dissipated,
        "residual": point.residual,
        "iterations": state.steps,
        "converged": at_load,
        "snapped": state.snapped,
        "tied": state.tied,
        "load": reached,
        "memories": jax.tree.map(
            lambda new, old: jnp.where(at_load, new, old), state.memories, state.anchor.memories
        ),
    }
    of_snap = {
        "snap_step": state.load,
        "snap_load": snap_load,
        "before": state.anchor.q,
        "after": point.q,
        "released": released,
        "taken": taken,
    }
    return Entry(jnp.asarray(state.load), jnp.asarray(state.snaps), done, jumped, of_load, of_snap)


def recorded(records: Records, entry: Entry, jacobian: AnyArray) -> Records:
    """The records with what is to be recorded; `jacobian`: ∂∇Π/∂q at the point."""

    def put(at: AnyArray, wanted: AnyArray) -> Callable[[AnyArray, AnyArray], Array]:
        return lambda into, value: jnp.asarray(into).at[at].set(jnp.where(wanted, value, into[at]))

    of_load = put(jnp.minimum(entry.load, len(records.q) - 1), entry.done)
    of_snap = put(jnp.minimum(entry.snap, SNAPS - 1), entry.jumped)
    new = {
        name: jax.tree.map(of_load, getattr(records, name), value) for name, value in entry.of_load.items()
    }
    new["hessian"] = of_load(records.hessian, jacobian)
    new |= {name: of_snap(getattr(records, name), value) for name, value in entry.of_snap.items()}
    return records._replace(**new)

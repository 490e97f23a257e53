"""A robot: a kinematic tree, and the energy terms that act on it."""

from dataclasses import replace

import jax.numpy as jnp
from jaxtyping import Array, Float

from exosight.errors import InputError
from exosight.mechanics.kinematics import Motion
from exosight.mechanics.term import Memories, Term, TermWithMemory
from exosight.mechanics.tree import Body, Tree


class Robot(Tree):
    """A tree and the terms whose sum with its elasticity is the energy."""

    terms: tuple[Term, ...]

    def __init__(self, bodies: tuple[Body, ...], terms: tuple[Term, ...] = ()) -> None:
        super().__init__(bodies)
        self.terms = tuple(terms)
        for term in self.terms:
            channel = getattr(term, "channel", 0)
            if not isinstance(channel, int) or channel < 0:
                raise InputError(
                    f"{type(term).__name__}: expected a load channel 0, 1, 2 …, got {channel}; "
                    "channels count the columns of the loads"
                )

    @property
    def conservative(self) -> bool:
        """Whether all terms have an energy, so that an equilibrium is a minimum of one."""
        return all(term.conservative for term in self.terms)

    @property
    def loads(self) -> int:
        """Number of load channels that the terms need."""
        return max((term.loads for term in self.terms), default=0)

    @property
    def clocks(self) -> set[int]:
        """Load channels in which terms expect the time [s]."""
        return {term.clock for term in self.terms if term.clock is not None}

    @property
    def memories(self) -> Memories:
        """What its terms remember, one array for each that does."""
        return tuple(term.memory for term in self._with_memory)

    def with_memories(self, memories: Memories) -> "Robot":
        """The same robot with other memories; InputError unless there is one for each term that remembers."""
        if len(memories) != len(self.memories):
            raise InputError(
                f"history: expected {len(self.memories)} arrays, one for each term with a memory, got "
                f"{len(memories)}; give the history of the equilibria that q comes from"
            )
        given = iter(memories)
        terms = tuple(
            replace(term, memory=next(given)) if isinstance(term, TermWithMemory) else term
            for term in self.terms
        )
        return Robot(self.bodies, terms)

    def remember(self, motion: Motion, loads: Float[Array, " loads"]) -> Memories:
        """What its terms know from now on, when a step has ended at this pose and these loads."""
        return tuple(term.remember(self, motion, loads) for term in self._with_memory)

    def dissipated(self) -> Float[Array, ""]:
        """What its terms with a memory have lost so far [J]."""
        return sum((term.dissipated() for term in self._with_memory), start=jnp.zeros(()))

    def discrepancy(
        self, motion: Motion, v: Float[Array, " dofs"], loads: Float[Array, " loads"]
    ) -> Float[Array, ""] | None:
        """The largest of its terms (`TermWithMemory.discrepancy`); None without any."""
        speeds = [term.discrepancy(self, motion, v, loads) for term in self._with_memory]
        return jnp.max(jnp.stack(speeds)) if speeds else None

    @property
    def _with_memory(self) -> list[TermWithMemory]:
        return [term for term in self.terms if isinstance(term, TermWithMemory)]

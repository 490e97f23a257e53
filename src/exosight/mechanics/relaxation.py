"""Viscoelastic rods: stress that relaxes, by Prony series with internal strains (generalised Maxwell model).

A rod's own modulus E is what is left after long times. Mode i adds a spring E_i in series with a damper, of
relaxation time τ_i and share g_i of the instantaneous modulus E₀ = E + Σ E_i, so E_i = g_i E/(1 − Σ g). The
strain h_i of its spring obeys

    dh_i/dt = dξ/dt − h_i/τ_i,

whose solution for a strain ξ that changes steadily over a step of time Δ is, with x = Δ/τ_i,

    h_i = e^(−x) h_i⁰ + (1 − e^(−x))/x · (ξ − ξ⁰):

of second order in the step, exact where ξ rests, for steps of any length. At the end of a step the strains
are remembered. Poisson's ratio does not relax. A snap takes no time, so in it nothing relaxes.

Source: J. C. Simo, T. J. R. Hughes, Computational Inelasticity (1998), section 10.3.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from exosight.arrays import AnyArray, floats
from exosight.errors import InputError
from exosight.mechanics.kinematics import Motion
from exosight.mechanics.rod import Rod
from exosight.mechanics.term import Bound, Expansion, TermWithMemory, one_channel, strain_columns, zero
from exosight.mechanics.tree import Tree


class Strains(NamedTuple):
    """What is remembered of a rod, at its points.

    whole        (points, 6)          ξ [1/m; -]
    springs      (modes, points, 6)   h
    time         ()                   when [s]
    dissipated   (points,)            what the dampers have lost so far [J]
    """

    whole: Float[AnyArray, "points 6"]
    springs: Float[AnyArray, "modes points 6"]
    time: Float[AnyArray, ""]
    dissipated: Float[AnyArray, " points"]

    @staticmethod
    def of(memory: Float[AnyArray, "points numbers"]) -> "Strains":
        """From the columns of an array."""
        springs = jnp.swapaxes(jnp.reshape(memory[:, 6:-2], (len(memory), -1, 6)), 0, 1)
        return Strains(memory[:, :6], springs, memory[0, -2], memory[:, -1])

    def array(self) -> Float[Array, "points numbers"]:
        """As the columns of an array."""
        time = jnp.full((len(self.whole), 1), self.time)
        return jnp.concatenate([self.whole, *self.springs, time, self.dissipated[:, None]], axis=1)


class Relaxation(TermWithMemory):
    """The relaxing part of a rod's stress.

    rod       its name (static)
    channel   of the loads, which holds the time [s] (static)
    share     (modes,)   g of the instantaneous modulus [-]
    time      (modes,)   τ [s]
    memory    (points, 6 modes + 8)   see `Strains`
    """

    rod: str = eqx.field(static=True)
    channel: int = eqx.field(static=True)
    share: Float[AnyArray, " modes"]
    time: Float[AnyArray, " modes"]

    @property
    def loads(self) -> int:
        """One more than its channel."""
        return self.channel + 1

    @property
    def clock(self) -> int:
        """Its channel."""
        return self.channel

    def stiffness(self, tree: Tree) -> Float[AnyArray, "modes points 6"]:
        """Of each mode at each point, times the length that the point stands for [N m³; N m]."""
        rod = tree[self.rod]
        assert isinstance(rod, Rod)
        own = rod.weights()[:, None] * rod.section.stiffness(rod.young, rod.poisson)
        share = jnp.asarray(self.share)
        return (share / (1 - jnp.sum(share)))[:, None, None] * own

    def dissipated(self) -> Float[Array, ""]:
        """Of all points."""
        return jnp.sum(jnp.asarray(Strains.of(self.memory).dissipated))

    def bind(self, tree: Tree) -> Bound:
        """`energy` is what the springs of the modes hold."""
        columns, stiffness = strain_columns(tree, self.rod), self.stiffness(tree)

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            old = Strains.of(self.memory)
            step = motion.strain[self.rod] - old.whole
            x, kept, gained = self._decay(loads)
            springs = kept * old.springs + gained * step
            # By x: that of e^(−x) is −e^(−x), that of (1 − e^(−x))/x is (e^(−x) − (1 − e^(−x))/x)/x.
            bend = jnp.where(x > 1e-4, (kept - gained) / jnp.where(x > 1e-4, x, 1.0), x / 3 - 0.5)
            rate = (bend * step - kept * old.springs) / jnp.asarray(self.time)[:, None, None]
            gradient, by_time = (jnp.einsum("mpk,mpk,pkq->q", stiffness, h, columns) for h in (springs, rate))
            tangent = jnp.sum(stiffness * gained, axis=0)
            return zero(tree, loads)._replace(
                energy=0.5 * jnp.sum(stiffness * springs**2),
                gradient=gradient,
                hessian=jnp.einsum("pka,pk,pkb->ab", columns, tangent, columns),
                load_gradient=one_channel(by_time, self.channel, len(loads)),
                coupling=jnp.zeros((tree.dofs, tree.dofs)),  # the step has no energy: its dampers take some
            )

        return expand

    def remember(
        self, tree: Tree, motion: Motion, loads: Float[Array, " loads"]
    ) -> Float[Array, "points numbers"]:
        """The strains now; what the dampers took, ∫ h²/τ dt for a strain that changed steadily."""
        old, strain = Strains.of(self.memory), motion.strain[self.rod]
        x, kept, gained = self._decay(loads)
        half = -jnp.expm1(-0.5 * x)
        ends = [old.springs, kept * old.springs + gained * (strain - old.whole)]
        # With h = p + s e^(−t/τ); for short steps Simpson's rule, as p grows there without bound.
        short = x < 1e-2
        p = (strain - old.whole) / jnp.where(short, 1.0, x)
        s = old.springs - p
        exact = p**2 * x + 2 * p * s * (1 - kept) + 0.5 * s**2 * (1 - kept**2)
        middle = (1 - half) * old.springs + jnp.where(short, 0.5 - 0.125 * x + x**2 / 48, 0.0) * (
            strain - old.whole
        )
        simpson = x / 6 * (ends[0] ** 2 + 4 * middle**2 + ends[1] ** 2)
        lost = jnp.sum(self.stiffness(tree) * jnp.where(short, simpson, exact), axis=(0, 2))
        return Strains(strain, ends[1], loads[self.channel], old.dissipated + lost).array()

    def discrepancy(
        self, tree: Tree, motion: Motion, v: Float[Array, " dofs"], loads: Float[Array, " loads"]
    ) -> Float[Array, ""]:
        """Of strains that did not change steadily: what the springs are off by, x/6 of it, as a speed."""
        rod, old, (x, _, _) = tree[self.rod], Strains.of(self.memory), self._decay(loads)
        assert isinstance(rod, Rod)
        passed = loads[self.channel] - old.time
        steady = (motion.strain[self.rod] - old.whole) / jnp.where(passed > 0, passed, 1.0)
        off = jnp.abs(strain_columns(tree, self.rod) @ v - steady)
        way = jnp.sum(rod.weights() @ (off[:, :3] * rod.length + off[:, 3:]))
        return jnp.where(passed > 0, jnp.minimum(jnp.max(x), 1.0) / 3 * way, 0.0)

    def _decay(
        self, loads: Float[Array, " loads"]
    ) -> tuple[Float[Array, "modes 1 1"], Float[Array, "modes 1 1"], Float[Array, "modes 1 1"]]:
        """x of each mode since what is remembered, e^(−x) and (1 − e^(−x))/x."""
        passed = jnp.maximum(loads[self.channel] - Strains.of(self.memory).time, 0.0)
        x = (passed / jnp.asarray(self.time))[:, None, None]
        some = jnp.where(x > 1e-8, x, 1.0)
        return x, jnp.exp(-x), jnp.where(x > 1e-8, -jnp.expm1(-some) / some, 1 - 0.5 * x)


def relaxation(
    rod: str, share: Sequence[float], time: Sequence[float], channel: int, tree: Tree
) -> Relaxation:
    """The relaxation of a rod that has never been strained, at time 0.

    share     of each mode [-], above 0 and below 1 in all
    time      of each mode [s], above 0
    channel   of the loads, which holds the time [s]

    Raises InputError for other numbers.
    """
    shares, times = np.asarray(share, float), np.asarray(time, float)
    if shares.ndim != 1 or not shares.size or not (np.all(shares > 0) and np.sum(shares) < 1):
        raise InputError(f"relaxation, share: expected some numbers above 0, below 1 in all, got {share}")
    if times.shape != shares.shape or not (np.all(times > 0) and np.all(np.isfinite(times))):
        raise InputError(f"relaxation, time: expected {len(shares)} finite times above 0 s, got {time}")
    body = tree[rod]
    if not isinstance(body, Rod):
        raise InputError(f"relaxation: expected the name of a rod, got the link {rod!r}")
    memory = np.zeros((body.frames, 6 * len(shares) + 8))
    memory[:, :6] = body.natural[: body.frames]
    return Relaxation(memory, rod, channel, floats(shares), floats(times))

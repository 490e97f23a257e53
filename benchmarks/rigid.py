"""Rigid bodies that press and rub, by exosight and by MuJoCo: error and time side by side, in one run.

`python -m benchmarks.rigid`, with the extra `compare` installed, writes docs/results/rigid.json, which
docs/validation.md shows. Times as in `benchmarks.neighbours`.

block   a capsule pressed on a plane with 1 N and drawn along it against a spring, to and fro: where it is
        at eight pulls, against Coulomb's law with rigid bodies
chain   three capsules on sprung hinges, a finger, bent by one that is pressed on the second of them: the
        hinges' angles, against the minimum of the energy with the two just touching

MuJoCo finds rest by letting damped motion die away, slow enough that nothing overshoots, until nothing moves
faster than 1e-6 m/s or rad/s.
"""

from collections.abc import Callable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Float
from scipy.optimize import root

from benchmarks.neighbours import RESULTS, Case, write
from exosight import lie
from exosight.mechanics import DeadForce, Link, Prismatic, Revolute, Robot, drive
from exosight.mechanics.friction import friction
from exosight.mechanics.rigid_contact import RigidContact
from exosight.mechanics.surface_contact import Plane, Solids
from exosight.mechanics.tree import Tree

MU, SPRING, WEAK = 0.3, 10.0, 1.0
"""Friction; stiffness along the plane, and against the press where nothing else holds [N/m]."""
PULLS = [0.0, 0.2, 0.299, 0.35, 0.5, 0.2, -0.05, -0.3]
"""[N], with 1 N across."""
PLACES = np.array([0.0, 0.0, 0.0, 0.005, 0.02, 0.02, 0.02, 0.0])
"""What Coulomb's law with rigid bodies gives [m]: it moves where |pull − SPRING x| passes 0.3 N."""

LENGTHS, HINGES, THICK = (0.045, 0.025, 0.025), (0.05, 0.03, 0.02), 0.008
"""Of the chain's capsules [m], their hinges [N m/rad], their radius [m]."""
AT, ROUND, PRESS = 0.055, 0.006, 0.5
"""Place along the straight chain and radius of the capsule that presses [m], and its force [N]."""

STILL, LONGEST = 1e-6, 10.0
"""Speed at which MuJoCo's bodies count as at rest [m/s, rad/s]; for no longer than this [s]."""

Places = Float[np.ndarray, " _"]


@dataclass(frozen=True)
class Block:
    """Exosight's, with contact of so many N/m."""

    stiffness: float

    def __call__(self) -> Places:
        """Build, drive, and read the place at each pull [m]."""
        site = np.zeros((1, 3))
        slider = Link("slider", 0.0, site, joint=Prismatic((1.0, 0.0, 0.0), stiffness=SPRING))
        up = Prismatic((0.0, 0.0, 1.0), stiffness=WEAK)
        mount = lie.translation(jnp.array([0.0, 0.0, 0.005]))
        bodies = (slider, Link("block", 0.03, site, parent="slider", joint=up, mount=mount))
        solids = Solids((("block", 0),), np.array([0.03]), np.array([[0.005, 0.005]]))
        plane = Plane(None, np.zeros(3), np.array([0.0, 0.0, 1.0]))
        contact = RigidContact(solids, plane, np.array(self.stiffness))
        pulls = (
            DeadForce("block", 0, 0, jnp.array([1.0, 0, 0])),
            DeadForce("block", 0, 1, jnp.array([0, 0, -1.0])),
        )
        robot = Robot(bodies, (*pulls, contact, friction(contact, MU, Tree(bodies))))
        found = drive([robot], np.array([(pull, 1.0) for pull in PULLS]))
        if not found.converged.all():
            raise RuntimeError("exosight did not converge")
        return found.q[0, :, 0]


@dataclass(frozen=True)
class Chain:
    """Exosight's, with contact of so many N/m."""

    stiffness: float

    def __call__(self) -> Places:
        """Build, drive, and read the hinges' angles [rad]."""
        links = []
        for i, (length, spring) in enumerate(zip(LENGTHS, HINGES, strict=True)):
            joint = Revolute((0.0, 1.0, 0.0), stiffness=spring)
            parent = f"link_{i - 1}" if i else None
            links.append(Link(f"link_{i}", length, np.zeros((1, 3)), parent=parent, joint=joint))
        across = lie.translation(jnp.array([AT, -0.015, THICK + ROUND])) @ lie.exp(
            jnp.array([0.0, 0.0, np.pi / 2, 0.0, 0.0, 0.0])
        )
        down = Prismatic((0.0, 0.0, 1.0), stiffness=WEAK)
        bar = Link("bar", 0.03, np.zeros((1, 3)), joint=down, mount=across)
        chain = Solids(
            tuple((link.name, 0) for link in links), np.array(LENGTHS), np.full((len(links), 2), THICK)
        )
        presser = Solids((("bar", 0),), np.array([0.03]), np.full((1, 2), ROUND))
        contact = RigidContact(presser, chain, np.array(self.stiffness))
        force = DeadForce("bar", 0, 0, jnp.array([0.0, 0.0, -1.0]))
        found = drive([Robot((*links, bar), (force, contact))], np.array([[PRESS]]))
        if not found.converged.all():
            raise RuntimeError("exosight did not converge")
        return found.q[0, 0, : len(LENGTHS)]


def angles() -> Places:
    """The hinges' angles [rad] at which the energy is least with the bar just touching the second capsule."""

    def energy(angle: jax.Array) -> jax.Array:
        along, tilt = angle[0], angle[0] + angle[1]
        x, z = LENGTHS[0] * jnp.cos(along), -LENGTHS[0] * jnp.sin(along)
        height = z + (THICK + ROUND - (AT - x) * jnp.sin(tilt)) / jnp.cos(tilt) - THICK - ROUND
        springs = 0.5 * jnp.asarray(HINGES[:2]) @ angle**2
        return springs + PRESS * height + 0.5 * WEAK * height**2

    found = root(jax.jit(jax.grad(energy)), np.array([0.3, 0.1]), tol=1e-14)
    return np.array([*found.x, 0.0])


BLOCK = f"""
<worldbody>
  <geom type="plane" size="1 1 1" friction="{MU} 0 0" {{contact}}/>
  <body pos="0 0 0.005">
    <joint type="slide" axis="1 0 0" stiffness="{SPRING}" damping="0.5"/>
    <joint type="slide" axis="0 0 1" stiffness="{WEAK}" damping="0.5"/>
    <geom type="capsule" fromto="0 0 0 0.03 0 0" size="0.005" mass="0.01" friction="{MU} 0 0" {{contact}}/>
  </body>
</worldbody>"""


def _chain_xml() -> str:
    inner = ""
    for i in reversed(range(len(LENGTHS))):
        place = LENGTHS[i - 1] if i else 0
        inner = (
            f'<body pos="{place} 0 0">'
            f'<joint type="hinge" axis="0 1 0" stiffness="{HINGES[i]}" damping="0.005"/>'
            f'<geom type="capsule" fromto="0 0 0 {LENGTHS[i]} 0 0" size="{THICK}" mass="0.01" '
            f'condim="1" {{contact}}/>{inner}</body>'
        )
    bar = (
        f'<body pos="{AT} 0 {THICK + ROUND}">'
        f'<joint type="slide" axis="0 0 1" stiffness="{WEAK}" damping="1"/>'
        f'<geom type="capsule" fromto="0 -0.015 0 0 0.015 0" size="{ROUND}" mass="0.01" '
        'condim="1" {contact}/></body>'
    )
    return f"<worldbody>{inner}{bar}</worldbody>"


@dataclass(frozen=True)
class MuJoCo:
    """Its model of a problem, with attributes of `option` and of the geoms.

    loads   (loads, coordinates)   forces along the coordinates, one after the other [N, N m]
    """

    world: str
    option: str
    contact: str
    loads: tuple[tuple[float, ...], ...]

    def __call__(self) -> np.ndarray:
        """Build, let motion die away under each load, and read the coordinates (loads, coordinates)."""
        option = f'<option gravity="0 0 0" cone="elliptic" integrator="implicitfast" {self.option}/>'
        world = self.world.replace("{contact}", self.contact)
        model = mujoco.MjModel.from_xml_string(f"<mujoco>{option}{world}</mujoco>")
        data = mujoco.MjData(model)
        found = []
        for load in self.loads:
            data.qfrc_applied[:] = load
            end = data.time + LONGEST
            mujoco.mj_step(model, data, nstep=20)
            while np.abs(data.qvel).max() > STILL and data.time < end:
                mujoco.mj_step(model, data, nstep=20)
            found.append(data.qpos.copy())
        return np.array(found)


SETTINGS = {
    "as it comes": ("", ""),
    "solref 4 ms": ('timestep="0.001"', 'solref="0.004 1"'),
    "solref 4 ms, impratio 100": ('timestep="0.001" impratio="100"', 'solref="0.004 1"'),
    "solref 4 ms, no slip": ('timestep="0.001" noslip_iterations="20"', 'solref="0.004 1"'),
}
"""Attributes of MuJoCo's option and geoms; the last two are about friction."""


def cases() -> list[Case]:
    """Both problems by both programs."""
    exact = angles()
    pulls = tuple((pull, -1.0) for pull in PULLS)
    press = ((0.0, 0.0, 0.0, -PRESS),)

    def off(expected: np.ndarray, read: Callable[[np.ndarray], np.ndarray]) -> Callable[[np.ndarray], float]:
        return lambda found: float(np.abs(read(found) - expected).max() / np.abs(expected).max())

    place, hinges = off(PLACES, lambda q: q[:, 0]), off(exact, lambda q: q[0, :3])
    same_place, same_hinges = off(PLACES, lambda x: x), off(exact, lambda x: x)
    stiff = (1e4, 1e6, 1e8)
    return [
        *(Case("block", "exosight", f"{k:.0e} N/m", Block(k), same_place) for k in stiff),
        *(Case("block", "MuJoCo", name, MuJoCo(BLOCK, *how, pulls), place) for name, how in SETTINGS.items()),
        *(Case("chain", "exosight", f"{k:.0e} N/m", Chain(k), same_hinges) for k in stiff),
        *(
            Case("chain", "MuJoCo", name, MuJoCo(_chain_xml(), *SETTINGS[name], press), hinges)
            for name in list(SETTINGS)[:2]
        ),
    ]


def main() -> None:
    """Measure anew and write the numbers of docs/validation.md."""
    write(RESULTS.with_name("rigid.json"), cases(), ("exosight", "mujoco", "jax", "numpy"))


if __name__ == "__main__":
    main()

"""Rigid bodies that press, rub and rest on each other, by exosight and by MuJoCo: error and time in one run.

`python -m benchmarks.rigid`, with the extra `compare` installed, writes docs/results/rigid.json, which
docs/validation.md shows. Times as in `benchmarks.neighbours`. The closed
forms are those of rigid bodies with Coulomb friction.

stick, slide   a capsule on a slope of 0.8 and of 1.5 times the friction angle's tangent, from rest: where it
               is after 0.5 s
stack          two capsules side by side on a plane and a third in the gap between them, which stand by
               friction alone: the contact forces
finger         three capsules on sprung hinges, bent by a fourth that is pressed on the second of them: the
               hinges' angles and the contact force at rest

MuJoCo finds rest by letting damped motion die away: the stack's for 1 s, the finger's until nothing moves
faster than 1e-7 m/s or rad/s.
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
from exosight.mechanics import (
    DeadForce,
    Gravity,
    Link,
    MotionOptions,
    Prismatic,
    Revolute,
    Robot,
    drive,
    evolve,
    walk,
)
from exosight.mechanics.friction import friction
from exosight.mechanics.rigid_contact import RigidContact
from exosight.mechanics.surfaces import Plane, Solids
from exosight.mechanics.tree import Tree

G, MASS, RADIUS, LENGTH = 9.81, 0.1, 0.005, 0.03
"""Of every capsule on the slope and in the stack [m/s², kg, m, m]; it has a ball's moment of inertia."""
INERTIA = 0.4 * MASS * RADIUS**2
MU_SLOPE, SLIDING_TIME = 0.3, 0.5
"""Friction [-], and how long it slides [s]."""

MU_STACK, SETTLING_TIME = 0.4, 1.0
HALF = 1.05 * RADIUS
"""Half the distance of the lower capsules' axes [m]."""
HELD = 1e-5
"""How far the springs of exosight's stack hold capsules into what they lie on [m]: where they just touch,
nothing but the weak springs tells where a first step leads."""
DRAG = 2.0
"""Damping of every slide of MuJoCo's stack [N s/m]; of rotation, times the radius squared."""
HIGH = np.sqrt(4 * RADIUS**2 - HALF**2)
"""The upper capsule's axis over the lower ones [m]."""

LENGTHS, HINGES, THICK = (0.045, 0.025, 0.025), (0.05, 0.03, 0.02), 0.008
"""Of the finger's capsules [m], their hinges [N m/rad], their radius [m]."""
AT, ROUND, PRESS = 0.055, 0.006, 0.3
"""Place along the straight finger and radius of the capsule that presses [m], and its force [N]."""
WEAK = 1.0
"""Spring where nothing else holds [N/m]: the capsule that presses, in both programs, and exosight's stack."""
STILL, LONGEST = 1e-7, 10.0
"""Speed at which MuJoCo's finger counts as at rest [m/s, rad/s]; for no longer than this [s]."""

Numbers = Float[np.ndarray, " _"]
GROUND = Plane(None, np.zeros(3), np.array([0.0, 0.0, 1.0]))
ALONG_Y = np.array([0.0, 0.0, np.pi / 2])
_walk = jax.jit(walk)


def _capsule(name: str, x: float, z: float, spring: float, *, turned: bool) -> list[Link]:
    """A capsule with its middle at (x, z), on slides along x and z; if turned, its axis is y and it may roll.

    spring   stiffness of the slides [N/m]; of rotation, times the radius squared
    """
    middle = np.array([[0.0, 0.0, 0.0], [LENGTH / 2, 0.0, 0.0]])
    axis = lie.exp(jnp.concatenate([ALONG_Y if turned else np.zeros(3), np.zeros(3)]))
    own = axis @ lie.translation(jnp.array([-LENGTH / 2, 0.0, 0.0]))
    place = lie.translation(jnp.array([x, 0.0, z]))
    lift = Prismatic((0.0, 0.0, 1.0), stiffness=spring)
    return [
        Link(
            f"{name}_x",
            0.0,
            np.zeros((1, 3)),
            joint=Prismatic((1.0, 0.0, 0.0), stiffness=spring),
            mount=place,
        ),
        Link(f"{name}_z", 0.0, np.zeros((1, 3)), parent=f"{name}_x", joint=lift),
        Link(
            name,
            LENGTH,
            middle,
            parent=f"{name}_z",
            joint=Revolute((1.0, 0.0, 0.0), stiffness=spring * RADIUS**2) if turned else None,
            mount=own,
            mass=np.array([0.0, MASS]),
            inertia=np.array([0.0, INERTIA])[:, None, None] * np.eye(3),
        ),
    ]


def _solids(*names: str) -> Solids:
    return Solids(
        tuple((name, 0) for name in names), np.full(len(names), LENGTH), np.full((len(names), 2), RADIUS)
    )


def _rigid_slide(slope: float) -> float:
    """Acceleration down a slope [m/s²]."""
    return G * max(np.sin(slope) - MU_SLOPE * np.cos(slope), 0.0)


@dataclass(frozen=True)
class Slope:
    """Exosight's capsule on a slope of so many times the friction angle's tangent."""

    steepness: float
    stiffness: float
    tolerance: float

    def __call__(self) -> float:
        """How far it has come [m]."""
        slope = np.arctan(MU_SLOPE * self.steepness)
        bodies = tuple(_capsule("capsule", 0.0, RADIUS, 0.0, turned=False))
        contact = RigidContact(_solids("capsule"), GROUND, np.array(self.stiffness))
        weight = Gravity(G * jnp.array([np.sin(slope), 0.0, -np.cos(slope)]))
        robot = Robot(bodies, (weight, contact, friction(contact, MU_SLOPE, Tree(bodies))))
        depth = MASS * G * np.cos(slope) / (2 * self.stiffness)
        found = evolve(
            [robot],
            np.array([0.0, SLIDING_TIME]),
            q=np.array([[0.0, -depth]]),
            options=MotionOptions(self.tolerance),
        )
        if not found.converged.all():
            raise RuntimeError("exosight did not converge")
        return float(found.q[0, -1, 0])


@dataclass(frozen=True)
class Stack:
    """Exosight's three capsules, at rest; springs of `WEAK` hold each where nothing else does."""

    stiffness: float

    def __call__(self) -> Numbers:
        """The contact forces [N], as `stacked` has them."""
        low, high = RADIUS - HELD, RADIUS + HIGH - 3 * HELD
        places = {"left": (-HALF, low), "right": (HALF, low), "top": (0.0, high)}
        bodies = tuple(
            link for name, place in places.items() for link in _capsule(name, *place, WEAK, turned=True)
        )
        tree, k = Tree(bodies), np.array(self.stiffness)
        contacts = (
            RigidContact(_solids("left", "right"), GROUND, k),
            RigidContact(_solids("top"), _solids("left", "right"), k),
        )
        rubbing = tuple(friction(contact, MU_STACK, tree) for contact in contacts)
        weights = tuple(DeadForce(f"{name}_z", 0, 0, jnp.array([0.0, 0.0, -1.0])) for name in places)
        robot = Robot(bodies, (*weights, *contacts, *rubbing))
        found = drive([robot], np.array([[MASS * G]]))
        if not found.converged.all():
            raise RuntimeError("exosight did not converge")
        robot = robot.with_memories(tuple(jnp.asarray(memory[0, 0]) for memory in found.history))
        motion = _walk(robot, found.q[0, 0])
        pushes = [np.asarray(contact.pressing(robot, motion).force) for contact in contacts]
        rubs = [np.linalg.norm(term.forces(robot, motion), axis=1) for term in robot.terms[-2:]]
        ground = [forces[0].reshape(2, 2).sum(axis=1) for forces in (pushes, rubs)]
        return np.concatenate([*ground, pushes[1], rubs[1]])


def stacked() -> Numbers:
    """Normal forces, then friction, of both lower capsules on the ground, and of the upper one on them [N].

    With θ = asin(HALF / 2 RADIUS) and the weight W of one: 3W/2 on the ground, W/2 between the capsules, and
    W/2 tan(θ/2) of friction everywhere, which stands while that is at most μ W/2.
    """
    weight, rub = MASS * G, np.tan(0.5 * np.arcsin(HALF / (2 * RADIUS)))
    return 0.5 * weight * np.repeat([3.0, rub, 1.0, rub], 2)


@dataclass(frozen=True)
class Finger:
    """Exosight's finger."""

    stiffness: float

    def __call__(self) -> Numbers:
        """The hinges' angles [rad], and the contact force [N]."""
        links = []
        for i, (length, spring) in enumerate(zip(LENGTHS, HINGES, strict=True)):
            joint = Revolute((0.0, 1.0, 0.0), stiffness=spring)
            parent = f"link_{i - 1}" if i else None
            links.append(Link(f"link_{i}", length, np.zeros((1, 3)), parent=parent, joint=joint))
        across = lie.translation(jnp.array([AT, -LENGTH / 2, THICK + ROUND])) @ lie.exp(
            jnp.concatenate([ALONG_Y, np.zeros(3)])
        )
        down = Prismatic((0.0, 0.0, 1.0), stiffness=WEAK)
        bar = Link("bar", LENGTH, np.zeros((1, 3)), joint=down, mount=across)
        chain = Solids(
            tuple((link.name, 0) for link in links), np.array(LENGTHS), np.full((len(links), 2), THICK)
        )
        presser = Solids((("bar", 0),), np.array([LENGTH]), np.full((1, 2), ROUND))
        contact = RigidContact(presser, chain, np.array(self.stiffness))
        force = DeadForce("bar", 0, 0, jnp.array([0.0, 0.0, -1.0]))
        robot = Robot((*links, bar), (force, contact))
        found = drive([robot], np.array([[PRESS]]))
        if not found.converged.all():
            raise RuntimeError("exosight did not converge")
        push = contact.pressing(robot, _walk(robot, found.q[0, 0])).force
        return np.append(found.q[0, 0, : len(LENGTHS)], np.sum(push))


def pressed() -> Numbers:
    """As `Finger` returns it: the least energy with the bar just touching the second capsule."""

    def height(angle: jax.Array) -> jax.Array:
        along, tilt = angle[0], angle[0] + angle[1]
        x, z = LENGTHS[0] * jnp.cos(along), -LENGTHS[0] * jnp.sin(along)
        return z + (THICK + ROUND - (AT - x) * jnp.sin(tilt)) / jnp.cos(tilt) - THICK - ROUND

    def energy(angle: jax.Array) -> jax.Array:
        springs = 0.5 * jnp.asarray(HINGES[:2]) @ angle**2
        return springs + PRESS * height(angle) + 0.5 * WEAK * height(angle) ** 2

    found = root(jax.jit(jax.grad(energy)), np.array([0.3, 0.1]), tol=1e-14)
    push = (PRESS + WEAK * float(height(found.x))) / np.cos(found.x.sum())
    return np.array([*found.x, 0.0, push])


def _slope_xml(steepness: float) -> str:
    angle = np.arctan(MU_SLOPE * steepness)
    return f"""
<option gravity="{G * np.sin(angle)} 0 {-G * np.cos(angle)}"/>
<default><geom friction="{MU_SLOPE} 0 0"/></default>
<worldbody>
  <geom type="plane" size="1 1 1"/>
  <body pos="0 0 {RADIUS}">
    <joint type="slide" axis="1 0 0"/> <joint type="slide" axis="0 0 1"/>
    <geom type="capsule" fromto="{-LENGTH / 2} 0 0 {LENGTH / 2} 0 0" size="{RADIUS}" mass="{MASS}"/>
  </body>
</worldbody>"""


def _stack_xml() -> str:
    def capsule(name: str, x: float, z: float) -> str:
        return f"""
  <body pos="{x} 0 {z}">
    <inertial pos="0 0 0" mass="{MASS}" diaginertia="{INERTIA} {INERTIA} {INERTIA}"/>
    <joint type="slide" axis="1 0 0" damping="{DRAG}"/> <joint type="slide" axis="0 0 1" damping="{DRAG}"/>
    <joint type="hinge" axis="0 1 0" damping="{DRAG * RADIUS**2}"/>
    <geom name="{name}" type="capsule" fromto="0 {-LENGTH / 2} 0 0 {LENGTH / 2} 0" size="{RADIUS}"/>
  </body>"""

    bodies = capsule("left", -HALF, RADIUS) + capsule("right", HALF, RADIUS)
    return f"""
<option gravity="0 0 {-G}"/>
<default><geom friction="{MU_STACK} 0 0"/></default>
<worldbody>
  <geom name="ground" type="plane" size="1 1 1"/> {bodies} {capsule("top", 0.0, RADIUS + HIGH)}
</worldbody>"""


def _finger_xml() -> str:
    inner = ""
    for i in reversed(range(len(LENGTHS))):
        inner = f"""
  <body pos="{LENGTHS[i - 1] if i else 0} 0 0">
    <joint type="hinge" axis="0 1 0" stiffness="{HINGES[i]}" damping="0.005"/>
    <geom name="link_{i}" type="capsule" fromto="0 0 0 {LENGTHS[i]} 0 0" size="{THICK}" mass="0.01"/>
    {inner}
  </body>"""
    return f"""
<option gravity="0 0 0"/>
<default><geom condim="1"/></default>
<worldbody> {inner}
  <body pos="{AT} 0 {THICK + ROUND}">
    <joint type="slide" axis="0 0 1" stiffness="{WEAK}" damping="1"/>
    <geom name="bar" type="capsule" fromto="0 {-LENGTH / 2} 0 0 {LENGTH / 2} 0" size="{ROUND}" mass="0.01"/>
  </body>
</worldbody>"""


@dataclass(frozen=True)
class MuJoCo:
    """Its model of a problem, with attributes of `option` and of the geoms, and a way to run and read it."""

    world: str
    option: str
    geom: str
    run: Callable[[mujoco.MjModel, mujoco.MjData], np.ndarray | float]

    def __call__(self) -> np.ndarray | float:
        """Build, run, read."""
        option = f'<option cone="elliptic" integrator="implicitfast" {self.option}/>'
        geom = f"<default><geom {self.geom}/></default>"
        model = mujoco.MjModel.from_xml_string(f"<mujoco>{option}{geom}{self.world}</mujoco>")
        return self.run(model, mujoco.MjData(model))


def _slid(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    mujoco.mj_step(model, data, nstep=round(SLIDING_TIME / model.opt.timestep))
    return float(data.qpos[0])


def _stood(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    mujoco.mj_step(model, data, nstep=round(SETTLING_TIME / model.opt.timestep))
    mujoco.mj_forward(model, data)
    pairs = (("ground", "left"), ("ground", "right"), ("left", "top"), ("right", "top"))
    forces = np.array([_force(model, data, *pair) for pair in pairs])
    return np.concatenate([forces[:2].T.ravel(), forces[2:].T.ravel()])


def _bent(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    data.qfrc_applied[-1] = -PRESS
    mujoco.mj_step(model, data, nstep=20)
    while np.abs(data.qvel).max() > STILL and data.time < LONGEST:
        mujoco.mj_step(model, data, nstep=20)
    mujoco.mj_forward(model, data)
    push = sum(_force(model, data, f"link_{i}", "bar")[0] for i in range(len(LENGTHS)))
    return np.append(data.qpos[: len(LENGTHS)], push)


def _force(model: mujoco.MjModel, data: mujoco.MjData, *names: str) -> tuple[float, float]:
    """Normal force and friction between two geoms [N]."""
    pair, found, one = {model.geom(name).id for name in names}, np.zeros(3), np.zeros(6)
    for i in range(data.ncon):
        if set(data.contact[i].geom.tolist()) == pair:
            mujoco.mj_contactForce(model, data, i, one)
            found += one[:3]
    return found[0], float(np.hypot(*found[1:]))


SETTINGS = {
    "as it comes": ("", ""),
    "solref 2 ms": ('timestep="0.001"', 'solref="0.002 1"'),
    "solref 2 ms, impratio 100": ('timestep="0.001" impratio="100"', 'solref="0.002 1"'),
    "solref 2 ms, no slip": ('timestep="0.001" noslip_iterations="50"', 'solref="0.002 1"'),
}
"""Attributes of MuJoCo's option and geoms; the last two are about friction."""


def cases() -> list[Case]:
    """Every problem by both programs."""
    found: list[Case] = []
    for name, steepness in (("stick", 0.8), ("slide", 1.5)):
        slope = np.arctan(MU_SLOPE * steepness)
        free, exact = 0.5 * SLIDING_TIME**2 * np.array([G * np.sin(slope), _rigid_slide(slope)])
        scale = exact or free

        def off(at: float, exact: float = exact, scale: float = scale) -> float:
            return abs(at - exact) / scale

        found += [
            Case(name, "exosight", f"{k:.0e} N/m, {tol:.0e} m", Slope(steepness, k, tol), off)
            for k in (2e4, 1e6)
            for tol in (1e-6, 1e-8)
        ]
        found += [
            Case(name, "MuJoCo", setting, MuJoCo(_slope_xml(steepness), *how, _slid), off)
            for setting, how in SETTINGS.items()
        ]
    forces, rest = stacked(), pressed()
    sizes = np.array([*np.full(len(LENGTHS), rest[:-1].max()), rest[-1]])

    def off_stack(at: np.ndarray) -> float:
        return float(np.abs(at - forces).max() / (MASS * G))

    def off_finger(at: np.ndarray) -> float:
        return float((np.abs(at - rest) / sizes).max())

    found += [Case("stack", "exosight", f"{k:.0e} N/m", Stack(k), off_stack) for k in (5e3, 2e4)]
    found += [
        Case("stack", "MuJoCo", setting, MuJoCo(_stack_xml(), *how, _stood), off_stack)
        for setting, how in SETTINGS.items()
    ]
    found += [Case("finger", "exosight", f"{k:.0e} N/m", Finger(k), off_finger) for k in (1e4, 1e6)]
    found += [
        Case("finger", "MuJoCo", setting, MuJoCo(_finger_xml(), *SETTINGS[setting], _bent), off_finger)
        for setting in list(SETTINGS)[:2]
    ]
    return found


def main() -> None:
    """Measure anew and write the numbers of docs/validation.md."""
    write(RESULTS.with_name("rigid.json"), cases(), ("exosight", "mujoco", "jax", "numpy"))


if __name__ == "__main__":
    main()

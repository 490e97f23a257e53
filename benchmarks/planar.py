"""A cantilever at rest in the x–z plane as an ordinary differential equation: what each program should find.

The rod of all comparisons at rest, and its shooting solution by SciPy's DOP853 at 1e-11. No program's
discretisation enters, so an error against it is that program's own.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.integrate import solve_ivp
from scipy.optimize import root

LENGTH, RADIUS, YOUNG, DENSITY = 0.3, 0.01, 1e6, 1000.0
"""[m], [m], [Pa], [kg/m³]; incompressible, so that the shear modulus is a third of Young's."""
AREA = np.pi * RADIUS**2
EI, EA, GA = YOUNG * AREA * RADIUS**2 / 4, YOUNG * AREA, YOUNG / 3 * AREA

TIP_FORCE = 2 * EI / LENGTH**2
"""Dead force across the tip of the free cantilever [N]: its deflection is half of the length."""

PRESS = 0.05
"""Dead force down at the tip of the rod that lies on a sphere [N]."""
PROP, SPHERE, SPRING = 2 / 3 * LENGTH, 0.02, 1000.0
"""Place and radius of the sphere that touches the straight rod from below [m], contact stiffness [N/m]."""
CENTRE = np.array([PROP, -RADIUS - SPHERE])


@dataclass(frozen=True)
class Rest:
    """Where the tip is (x, z) [m], and what the sphere carries [N]."""

    tip: Float[np.ndarray, "2"]
    push: float


def at_rest(tip_force: float, *, sphere: bool = False, slides: bool = False, thins: bool = False) -> Rest:
    """The rod under a vertical dead force at its tip [N], free or on the sphere.

    x′ = r_t t + r_n n,  θ′ = M/EI,  M′ = −x′ × N,  r_t = 1 + N·t/EA,  r_n = N·n/GA, N constant but for the
    contact force k d along the line of centres; θ(0) = 0, M(L) = 0. Unknown are M(0), N(0) and, where the
    contact `slides` to the point of the rod nearest to the sphere instead of staying with the one above it at
    rest, that point.

    thins   PyElastica's material: the section shrinks as the rod stretches, EA and GA by |x′|, EI by |x′|³
    """

    def slope(_: float, state: np.ndarray, force: np.ndarray) -> list[float]:
        angle, moment = state[2:]
        along = force[0] * np.cos(angle) + force[1] * np.sin(angle)
        across = force[1] * np.cos(angle) - force[0] * np.sin(angle)
        length, r_t, r_n = 1.0, 1.0, 0.0
        for _ in range(5 if thins else 1):  # |x′| − 1 is below 1e-3, and so is each error to the one before
            r_t, r_n = 1 + along * length / EA, across * length / GA
            length = np.hypot(r_t, r_n) if thins else 1.0
        x = r_t * np.cos(angle) - r_n * np.sin(angle)
        z = r_t * np.sin(angle) + r_n * np.cos(angle)
        return [x, z, moment * length**3 / EI, z * force[0] - x * force[1]]

    def march(start: np.ndarray, way: tuple[float, float], force: np.ndarray) -> np.ndarray:
        done = solve_ivp(slope, way, start, method="DOP853", rtol=1e-11, atol=1e-13, args=(force,))
        return done.y[:, -1]

    tip = np.array([0.0, tip_force])

    def shoot(unknown: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """What must vanish, the tip's state, and the force on the sphere."""
        start = np.array([0.0, 0.0, 0.0, unknown[0]])
        if not sphere:
            end = march(start, (0, LENGTH), tip)
            return end[3:], end, 0.0
        force, place = unknown[1:3], unknown[3] if slides else PROP
        there = march(start, (0, place), force)
        apart = there[:2] - CENTRE
        distance = float(np.linalg.norm(apart))
        push = SPRING * (RADIUS + SPHERE - distance)
        end = march(there, (place, LENGTH), tip)
        wrong = [end[3:] / EI, force - tip - push * apart / distance]
        if slides:
            wrong.append([np.dot(apart, slope(place, there, force)[:2])])
        return np.concatenate(wrong), end, push

    guess = np.array([0.7 * tip_force * LENGTH])
    if sphere:
        push = beam_push(-tip_force)
        guess = np.array(
            [tip_force * LENGTH + push * PROP, 0.0, tip_force + push, PROP][: 4 if slides else 3]
        )
    found = root(lambda unknown: shoot(unknown)[0], guess, tol=1e-12)
    if not found.success:
        raise RuntimeError(f"the differential equation was not solved: {found.message}")
    _, end, push = shoot(found.x)
    return Rest(end[:2], push)


def beam_push(press: float) -> float:
    """What the sphere carries of a force down at the tip [N], for small deflections: a beam on a spring."""
    a = PROP
    return press * a**2 * (3 * LENGTH - a) / (6 * EI) / (a**3 / (3 * EI) + 1 / SPRING)

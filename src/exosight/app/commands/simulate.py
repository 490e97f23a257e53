"""`exosight simulate`: one exosuit under given loads."""

from typing import Annotated, Any

import tyro

from exosight.app.console import say, show, write_json
from exosight.errors import InputError
from exosight.evaluation.tables import Column, Table
from exosight.exosuit.shapes import FAMILIES, TABLE_I, ExosuitShape, ranges, shape_from_dict, shape_to_dict


def simulate(
    family: str = "linear",
    r0: float | None = None,
    r1: float | None = None,
    a: float | None = None,
    b: tuple[float, ...] | None = None,
    c: float | None = None,
    d: float | None = None,
    phi_c: float | None = None,
    phi_d: float | None = None,
    m: tuple[float, ...] | None = None,
    length: float = TABLE_I.length,
    young: float = 300e3,
    contact_stiffness: float = 1000.0,
    gap: float = 0.0,
    u: tuple[float, ...] = (0.0, 1.0, 2.0, 3.0, 4.0),
    json: Annotated[str | None, tyro.conf.arg(metavar="FILE|-")] = None,
) -> None:
    """Solve the stable equilibria of an exosuit on a finger under given loads.

    Each load is approached from rest in steps of at most 0.05 N, so an answer does not depend on which other
    loads are asked for. Without parameters it is the paper's exosuit (Table I).

    Example: exosight simulate --family linear --r0 0.01 --r1 0.005 --length 0.095 --u 0 1 2.4 4 --json -

    Args:
        family: surface of the exosuit: linear (r0, r1), sine (r0, a), cosine_sum (b), sine_cosine
            (r0, c, d, phi_c, phi_d) or legendre (m)
        r0: radius at the base, or mean radius [m], 0.004…0.010
        r1: radius at the tip [m], 0.004…0.010
        a: half waves of the sine along the exosuit, −15…0.001
        b: seven amplitudes of the cosine sum [0.1 mm], each −15…0.001
        c: half waves of the sine, 0.0001…5
        d: half waves of the cosine, 0.0001…5
        phi_c: phase of the sine [rad], 0…2π
        phi_d: phase of the cosine [rad], 0…2π
        m: six amplitudes of the Legendre polynomials [cm], each 0.001…1
        length: length of the exosuit [m], 0.07…0.11
        young: Young's modulus [Pa]
        contact_stiffness: penalty stiffness of the contact spheres [N/m]
        gap: clearance between exosuit and finger at the base [m]
        u: actuation [N]; positive pushes, negative pulls
        json: write all numbers as JSON to a new file, or to stdout with "-", instead of a table
    """
    given = {"r0": r0, "r1": r1, "a": a, "b": b, "c": c, "d": d, "phi_c": phi_c, "phi_d": phi_d, "m": m}
    shape = shape_of(family, {name: value for name, value in given.items() if value is not None}, length)
    # Here, so that --help and wrong options answer at once: JAX takes a second to import.
    from exosight.exosuit.assembly import Exosuit
    from exosight.exosuit.simulation import simulate as solve

    exosuit = Exosuit(shape, young=young, contact_stiffness=contact_stiffness, gap=gap)
    records = solve(exosuit, u).records()
    if json is None:
        show(_table(records))
        return
    about = {
        **shape_to_dict(shape),
        "young": exosuit.young,
        "contact_stiffness": exosuit.contact_stiffness,
        "gap": exosuit.gap,
    }
    units = {
        "u": "N",
        "forces": "N, C0…C7",
        "F_net": "N, C1…C7",
        "joint_angles": "rad",
        "rod_tip": "m, m, rad",
    }
    write_json({"exosuit": about, "units": units | {"finger_tip": "m, m"}, "path": records}, json)


def shape_of(family: str, parameters: dict[str, Any], length: float) -> ExosuitShape:
    """The shape of a family with these parameters; with none, the linear family is the Table I taper.

    Raises InputError naming an unknown family, or parameters that are missing, foreign or out of range.
    """
    if family in FAMILIES:
        wanted = ranges(FAMILIES[family])
        if family == "linear" and not parameters:
            parameters = shape_to_dict(TABLE_I)["parameters"]
        missing = [f"--{name.replace('_', '-')}" for name in wanted if name not in parameters]
        foreign = [f"--{name.replace('_', '-')}" for name in parameters if name not in wanted]
        if missing or foreign:
            raise InputError(
                f"family {family} takes {', '.join(wanted)}"
                + (f"; missing: {', '.join(missing)}" if missing else "")
                + (f"; not its own: {', '.join(foreign)}" if foreign else "")
            )
    return shape_from_dict({"family": family, "parameters": parameters, "length": length})


def _table(records: list[dict[str, Any]]) -> Table:
    columns = (
        Column("u", "N", digits=2),
        *(Column(f"C{i}", "N", digits=3) for i in range(8)),
        Column("F_net", "N", digits=3),
        Column("ok"),
        Column("its"),
    )
    rows = tuple(
        (
            *(r["u"], *r["forces"], r["F_net"]),
            *("yes" if r["converged"] else "NO", r["iterations"]),
        )
        for r in records
    )
    lost = sum(not r["converged"] for r in records)
    if lost:
        say(f"{lost} of {len(records)} loads found no stable equilibrium")
    return Table(
        "path",
        "Equilibria",
        columns,
        rows,
        "C0…C7: contact forces; F_net: their sum over C1…C7; ok: stable equilibrium; its: Newton steps",
    )

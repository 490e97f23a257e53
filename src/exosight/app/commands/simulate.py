"""`exosight simulate`: one exosuit under given loads."""

from typing import Annotated, Any

import tyro

from exosight.app.commands.options import Json
from exosight.app.console import check_json_target, say, show, waiting, write_json
from exosight.errors import InputError
from exosight.evaluation.tables import Column, Table
from exosight.exosuit.shapes import FAMILIES, TABLE_I, ExosuitShape, ranges, shape_from_dict, shape_to_dict

Number = Annotated[float | None, tyro.conf.arg(metavar="X", help_behavior_hint="")]
Numbers = Annotated[tuple[float, ...] | None, tyro.conf.arg(metavar="X X …", help_behavior_hint="")]

UNITS = {
    "u": "N",
    "residual": "relative",
    "min_eigenvalue": "1 at rest, 0 where the pose snaps",
    "forces": "N, C0 to C7",
    "F_net": "N, sum over C1 to C7",
    "joint_angles": "rad",
    "rod_tip": "x in m, z in m, angle in rad",
    "finger_tip": "x in m, z in m",
}


def simulate(
    family: Annotated[str, tyro.conf.arg(metavar="NAME")] = "linear",
    r0: Number = None,
    r1: Number = None,
    a: Number = None,
    b: Numbers = None,
    c: Number = None,
    d: Number = None,
    phi_c: Number = None,
    phi_d: Number = None,
    m: Numbers = None,
    length: float = TABLE_I.length,
    young: float = 300e3,
    contact_stiffness: float = 1000.0,
    gap: float = 0.0,
    u: Annotated[tuple[float, ...], tyro.conf.arg(metavar="X X …")] = (0.0, 1.0, 2.0, 3.0, 4.0),
    json: Json = None,
) -> None:
    """Solve the stable equilibria of an exosuit on a finger under given loads.

    Each load is approached from rest in steps of at most 0.05 N, so an answer does not depend on which other
    loads are asked for. Without parameters it is the paper's exosuit (Table I).

    Examples:
      exosight simulate --u 0 1 2.4 4
      exosight simulate --r0 0.01 --r1 0.005 --length 0.095 --u 2.4 --json -
      exosight simulate --family cosine_sum --b -15 -12 -9 -6 -3 0 0

    Args:
        family: surface of the exosuit: linear (r0, r1), sine (r0, a),
            cosine_sum (b), sine_cosine (r0, c, d, phi-c, phi-d) or
            legendre (m)
        r0: radius at the base, or mean radius [m], 0.004…0.01
        r1: radius at the tip [m], 0.004…0.01
        a: half waves of the sine along the exosuit, −15…0.001
        b: seven amplitudes of the cosine sum [0.1 mm], each −15…0.001
        c: half waves of the sine, 0.0001…5
        d: half waves of the cosine, 0.0001…5
        phi_c: phase of the sine [rad], 0…2π
        phi_d: phase of the cosine [rad], 0…2π
        m: six amplitudes of the Legendre polynomials [cm], each 0.001…1
        length: length of the exosuit [m], 0.07…0.11
        young: Young's modulus [Pa], 1e3…1e9
        contact_stiffness: penalty stiffness of the contact spheres [N/m], 1…1e6
        gap: clearance between exosuit and finger at the base [m], 0…0.1
        u: actuation [N], any number of loads within ±50; positive pushes, negative pulls
        json: write all numbers as JSON to a new file, or to stdout with "-", instead of a table
    """
    check_json_target(json)
    given = {"r0": r0, "r1": r1, "a": a, "b": b, "c": c, "d": d, "phi_c": phi_c, "phi_d": phi_d, "m": m}
    shape = shape_of(family, {name: value for name, value in given.items() if value is not None}, length)
    # Here, so that --help and wrong options answer at once: JAX takes a second to import.
    from exosight.exosuit.assembly import Exosuit
    from exosight.exosuit.simulation import simulate as solve

    exosuit = Exosuit(shape, young=young, contact_stiffness=contact_stiffness, gap=gap)
    with waiting("solving; the first time on a machine compiles, which takes ten seconds or more"):
        records = solve(exosuit, u).records()
    lost = sum(not record["converged"] for record in records)
    if lost:
        say(f"{lost} of {len(records)} loads found no stable equilibrium; their numbers are the best found")
    if json is None:
        show(_table(records))
    else:
        about = {"young": exosuit.young, "contact_stiffness": exosuit.contact_stiffness, "gap": exosuit.gap}
        write_json({"exosuit": {**shape_to_dict(shape), **about}, "units": UNITS, "path": records}, json)


def shape_of(family: str, parameters: dict[str, Any], length: float) -> ExosuitShape:
    """The shape of a family with these parameters; with none, the linear family is the Table I taper.

    Raises InputError naming an unknown family, or parameters that are missing, foreign or out of range.
    """
    if family == "linear" and not parameters:
        parameters = shape_to_dict(TABLE_I)["parameters"]
    if family in FAMILIES:
        wanted = ranges(FAMILIES[family])
        missing = [_option(name) for name in wanted if name not in parameters]
        foreign = [_option(name) for name in parameters if name not in wanted]
        if missing or foreign:
            raise InputError(
                f"family {family}: expected {', '.join(_option(name) for name in wanted)}"
                + (f"; missing: {', '.join(missing)}" if missing else "")
                + (f"; not its own: {', '.join(foreign)}" if foreign else "")
            )
    return shape_from_dict({"family": family, "parameters": parameters, "length": length})


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _table(records: list[dict[str, Any]]) -> Table:
    columns = (
        Column("u", "N"),
        *(Column(f"C{i}", "N", digits=3) for i in range(8)),
        Column("F_net", "N", digits=3),
        Column("ok"),
        Column("its"),
    )
    rows = tuple(
        (
            *(f"{record['u']:g}".replace("-", "−"), *record["forces"], record["F_net"]),
            *("yes" if record["converged"] else "NO", record["iterations"]),
        )
        for record in records
    )
    note = "C0…C7: contact forces; F_net: their sum over C1…C7; ok: stable equilibrium; its: Newton steps"
    return Table("path", "Equilibria", columns, rows, note)

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

Texts = Annotated[tuple[str, ...] | None, tyro.conf.arg(metavar="NAME=X,…", help_behavior_hint="")]

LOADS = (0.0, 1.0, 2.0, 3.0, 4.0)
NOMINAL = {"young": 300e3, "contact_stiffness": 1000.0, "gap": 0.0}
PUBLISHED = "published"
WAITING = "solving; the first time on a machine compiles, which takes ten seconds or more"

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
    young: float = NOMINAL["young"],
    contact_stiffness: float = NOMINAL["contact_stiffness"],
    gap: float = NOMINAL["gap"],
    u: Numbers = None,
    system: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")] = PUBLISHED,
    commands: Texts = None,
    json: Json = None,
) -> None:
    """Solve the stable equilibria of an exosuit on a finger, or of any system, under given loads.

    Each load is approached from rest in steps of at most 0.05 N, so an answer does not depend on which other
    loads are asked for. Without parameters it is the paper's exosuit (Table I). The options of an exosuit do
    not go with a system of your own, whose file says it all (docs/systems.md).

    Examples:
      exosight simulate --u 0 1 2.4 4
      exosight simulate --r0 0.01 --r1 0.005 --length 0.095 --u 2.4 --json -
      exosight simulate --family cosine_sum --b -15 -12 -9 -6 -3 0 0
      exosight simulate --system thumb.toml --u 1 2 4
      exosight simulate --system hand.toml --commands left=2,right=0.5 left=3

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
        u: actuation [N], any number of loads within ±50; positive pushes, negative pulls; 0 1 2 3 4 if
            left out; of another system with one channel: in the unit and range of that
        system: a preset or a system file, see `exosight system`
        commands: of a system, each one equilibrium: NAME=NUMBER of each channel, commas in between;
            channels left out rest at 0
        json: write all numbers as JSON to a new file, or to stdout with "-", instead of a table
    """
    check_json_target(json)
    about = {"young": young, "contact_stiffness": contact_stiffness, "gap": gap}
    given = {"r0": r0, "r1": r1, "a": a, "b": b, "c": c, "d": d, "phi_c": phi_c, "phi_d": phi_d, "m": m}
    given = {name: value for name, value in given.items() if value is not None}
    if system != PUBLISHED or commands is not None:
        nominal = {"family": "linear", "length": TABLE_I.length, **NOMINAL}
        chosen = {"family": family, "length": length, **about}
        _refuse([*given, *(name for name, value in chosen.items() if value != nominal[name])])
        _simulate_system(system, u, commands, json)
        return
    shape = shape_of(family, given, length)
    # Here, so that --help and wrong options answer at once: JAX takes a second to import.
    from exosight.exosuit.assembly import Exosuit
    from exosight.exosuit.simulation import simulate as solve

    exosuit = Exosuit(shape, young=young, contact_stiffness=contact_stiffness, gap=gap)
    with waiting(WAITING):
        records = solve(exosuit, LOADS if u is None else u).records()
    _say_lost(records)
    if json is None:
        show(_table(records))
    else:
        write_json({"exosuit": {**shape_to_dict(shape), **about}, "units": UNITS, "path": records}, json)


def _simulate_system(
    name: str, u: tuple[float, ...] | None, commands: tuple[str, ...] | None, json: str | None
) -> None:
    from exosight.app.system_path import path_table, simulated_path

    with waiting(WAITING):
        result = simulated_path(name, u, commands)
    _say_lost(result["path"])
    if json is None:
        show(path_table(result))
    else:
        write_json(result, json)


def _refuse(options: list[str]) -> None:
    """InputError for options of an exosuit beside --system or --commands."""
    if options:
        raise InputError(
            f"{_option(options[0])}: it is of the published exosuits; a system file says it itself, and "
            "--commands takes the nominal one"
        )


def _say_lost(records: list[dict[str, Any]]) -> None:
    lost = sum(not record["converged"] for record in records)
    if lost:
        say(f"{lost} of {len(records)} loads found no stable equilibrium; their numbers are the best found")


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
            *("yes" if record["converged"] else "NO", str(record["iterations"])),
        )
        for record in records
    )
    note = "C0…C7: contact forces; F_net: their sum over C1…C7; ok: stable equilibrium; its: evaluations"
    return Table("path", "Equilibria", columns, rows, note)

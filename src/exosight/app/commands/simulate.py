"""`exosight simulate`: one exosuit under given loads."""

from typing import TYPE_CHECKING, Annotated, Any

import tyro

from exosight.app.commands.options import (
    NO_OPTIONS,
    PUBLISHED,
    ExosuitOptions,
    Json,
    Numbers,
    Plot,
    SystemName,
)
from exosight.app.console import check_json_target, say, show_or_write, waiting
from exosight.app.output import check_plot
from exosight.errors import InputError
from exosight.evaluation.tables import Column, Table
from exosight.exosuit.shapes import TABLE_I, shape_to_dict

if TYPE_CHECKING:
    import numpy as np

    from exosight.system.observation import Observation
    from exosight.system.system import System

Texts = Annotated[tuple[str, ...] | None, tyro.conf.arg(metavar="NAME=X,…", help_behavior_hint="")]

LOADS = (0.0, 1.0, 2.0, 3.0, 4.0)
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
    exosuit: Annotated[ExosuitOptions, tyro.conf.arg(name="")] = NO_OPTIONS,
    u: Numbers = None,
    system: SystemName = PUBLISHED,
    commands: Texts = None,
    time: Numbers = None,
    motion: Annotated[float | None, tyro.conf.arg(metavar="S")] = None,
    poses: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    plot: Plot = None,
    json: Json = None,
) -> None:
    """Solve the stable equilibria of an exosuit on a finger, or of any system, under given loads.

    Each load is approached from rest in steps of at most 0.05 N, so an answer does not depend on which other
    loads are asked for. Without parameters it is the paper's exosuit (Table I). The options of an exosuit go
    with presets; the file of a system of your own says it all (docs/systems.md).

    Examples:
      exosight simulate --u 0 1 2.4 4 --plot path.pdf
      exosight simulate --r0 0.01 --r1 0.005 --length 0.095 --u 2.4 --json -
      exosight simulate --family cosine_sum --b -15 -12 -9 -6 -3 0 0
      exosight simulate --system index --r0 0.01 --r1 0.005 --length 0.095 --u 2.4
      exosight simulate --system thumb.toml --u 1 2 4
      exosight simulate --system hand.toml --commands left=2,right=0.5 left=3
      exosight simulate --system slow.toml --u 0 2 2 2 --time 0 1 10 100
      exosight simulate --system hit.toml --u 2 2 --time 0 0.5 --motion 0.01

    Args:
        exosuit: the exosuit
        u: actuation [N], any number of loads within ±50; positive pushes, negative pulls; 0 1 2 3 4 if
            left out; of another system with one channel: in the unit and range of that
        system: a preset or a system file, see `exosight system`
        commands: of a system, each one equilibrium: NAME=NUMBER of each channel, commas in between;
            channels left out rest at 0
        time: of a system file whose rods relax: when each load is reached [s], from rest at 0 s, one after
            the other; loads change evenly in between, at once where two times are equal. If left out,
            loads change infinitely slowly
        motion: move with inertia, viscosity and damping, from rest at 0 s, through the commands at the
            times of --time, and report every so many seconds
        poses: add the centreline and the radii of every body to the JSON: axis_NAME, radius_NAME [m]; and
            along every tube that is pressed on force_per_length_NAME [N/m] at the distances place_NAME [m]
        plot: draw all readings over the command, and the force per length along every tube that is pressed
            on, to a new file (PNG, PDF or SVG)
        json: write all numbers as JSON to a new file, or to stdout with "-", instead of a table
    """
    check_json_target(json)
    if poses and json is None:
        raise InputError("--poses: expected --json with it; a table has no room for them")
    check_plot(plot)
    if system != PUBLISHED or commands is not None or time is not None or motion is not None:
        # Here, so that --help and wrong options answer at once: JAX takes a second to import.
        from exosight.app.system_path import path_table, path_values, simulated_path

        with waiting(WAITING):
            nominal, states = simulated_path(system, exosuit, u, commands, time, motion)
        result = path_values(nominal, states)
        table = path_table(result)
        if nominal.relaxations and time is None:
            say("loads change infinitely slowly, so rods have relaxed; give --time to see how they do")
    else:
        worn = exosuit.exosuit(TABLE_I, PUBLISHED)
        from exosight.exosuit.simulation import simulate as solve
        from exosight.system.simulation import SystemStates

        with waiting(WAITING):
            solved = solve(worn, LOADS if u is None else u)
        records = solved.records()
        about = {name: getattr(worn, name) for name in ("young", "contact_stiffness", "gap")}
        result = {"exosuit": {**shape_to_dict(worn.shape), **about}, "units": UNITS, "path": records}
        table = _table(records)
        nominal = solved.system
        states = SystemStates(solved.u[:, None], solved.equilibria, solved.observation)
    _say_faults(nominal, states.observation, result["path"])
    if poses or plot is not None:
        from exosight.system.observation import POSE_UNITS, PROFILE_UNITS, body_shapes, force_profiles

        profiles = force_profiles(nominal, states.q, states.history)
        if poses:
            arrays = body_shapes(nominal, states.observation.axes) | profiles
            _add_arrays(result, arrays, POSE_UNITS | PROFILE_UNITS)
        if plot is not None:
            from exosight.app.plots import plot_path, write_plot

            lost = [not record["converged"] for record in result["path"]]
            write_plot(plot_path(nominal, states, profiles, lost), plot)
    show_or_write([table], result, json)


def _add_arrays(result: dict[str, Any], arrays: dict[str, "np.ndarray"], units: dict[str, str]) -> None:
    """Add arrays of shape (loads, …) to the records, with their units by the first word of each name."""
    result["units"] = result.get("units", {}) | {name: units[name.partition("_")[0]] for name in arrays}
    for i, record in enumerate(result["path"]):
        record |= {name: values[i].tolist() for name, values in arrays.items()}


def _say_faults(system: "System", seen: "Observation", records: list[dict[str, Any]]) -> None:
    from exosight.dataset.simulation import CROSSING, crossing

    crossed = int(crossing(system, seen.axes).sum())
    if crossed:
        say(f"in {crossed} of {len(records)} poses {CROSSING}")
    lost = sum(not record["converged"] for record in records)
    if lost:
        say(f"{lost} of {len(records)} loads found no stable equilibrium; their numbers are the best found")


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

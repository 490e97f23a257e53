"""`exosight simulate --system`: what any system does under commands of its channels."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from exosight.app.commands.options import ExosuitOptions
from exosight.app.nominal import nominal_system
from exosight.errors import InputError
from exosight.evaluation.metrics import finite_or_none
from exosight.evaluation.tables import Column, Table
from exosight.exosuit.catalogue import find_system
from exosight.exosuit.shapes import TABLE_I
from exosight.system.designs import FileDesigns
from exosight.system.motion import SystemMotion, simulate_motion
from exosight.system.schema import Schema, schema_to_dict
from exosight.system.simulation import SystemStates, simulate_path, simulate_system
from exosight.system.system import System


def simulated_path(
    name: str,
    exosuit: ExosuitOptions,
    u: Sequence[float] | None,
    commands: Sequence[str] | None,
    time: Sequence[float] | None = None,
    motion: float | None = None,
) -> tuple[System, SystemStates | SystemMotion]:
    """A preset or system file, and its equilibria or motion.

    exosuit    of a preset
    u          of a system with one channel: its commands
    commands   texts such as "left=2,right=0.5"; by default each channel from 0 to the far end of its range
    time       when each is reached [s], see `simulate_path`; by default each is approached from rest
    motion     with inertia, reported every so many seconds, see `simulate_motion`

    Raises InputError for a system that is none, options of an exosuit, commands or times that are not its
    own; ConvergenceError for a path in time without a stable equilibrium.
    """
    designs = find_system(name)
    if isinstance(designs, FileDesigns):
        exosuit.refuse("the system file says it itself")
    system = nominal_system(designs, exosuit.exosuit(TABLE_I, name))
    path = _commands(system.schema, u, commands)
    if motion is not None:
        if time is None:
            raise InputError("--motion: expected --time with it: when each command is reached [s]")
        return system, simulate_motion(system, path, np.array(time, float), motion)
    if time is not None:
        return system, simulate_path(system, path, times=np.array(time, float))
    return system, simulate_system(system, path)


def path_values(system: System, states: SystemStates | SystemMotion) -> dict[str, Any]:
    """The equilibria of a system, or its motion, as plain numbers."""
    return {
        "system": system.name,
        "schema": schema_to_dict(system.schema),
        "path": [_record(system, states, i) for i in range(len(states.commands))],
    }


def path_table(result: dict[str, Any]) -> Table:
    """The same as a table: commands, readings, whether the equilibrium was found."""
    schema, records = result["schema"], result["path"]
    timed, moving = "time" in records[0], "steps" in records[0]
    columns = (
        *([Column("time", "s")] if timed else []),
        *(Column(each["name"], each["unit"]) for each in schema["channels"]),
        *(Column(each["name"], each["unit"], digits=3) for each in schema["sensors"]),
        *([] if moving else [Column("ok"), Column("its")]),
    )
    rows = tuple(
        (
            *([f"{record['time']:g}"] if timed else []),
            *(f"{value:g}".replace("-", "−") for value in record["commands"].values()),
            *record["readings"].values(),
            *([] if moving else ["yes" if record["converged"] else "NO", record["iterations"]]),
        )
        for record in records
    )
    if moving:
        return Table("path", f"Motion of {result['system']}", columns, rows, "from rest at 0 s, with inertia")
    note = "ok: stable equilibrium; its: evaluations"
    return Table("path", f"Equilibria of {result['system']}", columns, rows, note)


def _commands(
    schema: Schema, u: Sequence[float] | None, texts: Sequence[str] | None
) -> Float[np.ndarray, "commands channels"]:
    names = [channel.name for channel in schema.channels]
    if u is not None and texts is not None:
        raise InputError("expected one of --u and --commands, got both")
    if texts is not None:
        return np.array([_command(text, names) for text in texts])
    if u is None:
        return np.linspace(0, 1, 5)[:, None] * [channel.peak for channel in schema.channels]
    if len(names) > 1:
        example = ",".join(f"{name}=1" for name in names)
        raise InputError(
            f"u: {schema.system} has the channels {', '.join(names)}; give --commands {example} instead"
        )
    return np.array(u, float)[:, None]


def _command(text: str, names: Sequence[str]) -> list[float]:
    """One number a channel from "left=2,right=0.5"; channels that are not named rest at 0."""
    values = dict.fromkeys(names, 0.0)
    named: set[str] = set()
    for part in text.split(","):
        name, equals, number = (word.strip() for word in part.partition("="))
        if not equals or name not in values or name in named:
            raise InputError(
                f"commands: expected NAME=NUMBER with commas in between, each of {', '.join(names)} at most "
                f"once, got {text[:80]!r}"
            )
        try:
            values[name] = float(number)
        except ValueError:
            raise InputError(f"commands: expected a number for {name}, got {number[:40]!r}") from None
        named.add(name)
    return list(values.values())


def _record(system: System, states: SystemStates | SystemMotion, i: int) -> dict[str, Any]:
    schema, seen = system.schema, states.observation
    readings = seen.readings[i].tolist()
    zones = zip(system.zones, seen.forces[i], seen.normals[i], strict=True)
    return {
        **({} if states.times is None else {"time": float(states.times[i])}),
        "commands": {c.name: x for c, x in zip(schema.channels, states.commands[i].tolist(), strict=True)},
        "readings": {s.name: finite_or_none(x) for s, x in zip(schema.sensors, readings, strict=True)},
        "zones": {
            zone.spec.name: {
                "magnitude": finite_or_none(float(np.linalg.norm(force))),
                "normal": finite_or_none(float(np.linalg.norm(normal))),
                "tangential": finite_or_none(float(np.linalg.norm(force - normal))),
            }
            for zone, force, normal in zones
        },
        **(_of_motion(states, i) if isinstance(states, SystemMotion) else _of_equilibrium(states, i)),
    }


def _of_equilibrium(states: SystemStates, i: int) -> dict[str, Any]:
    found = states.equilibria
    return {
        "converged": bool(found.converged[i]),
        "residual": finite_or_none(float(found.residual[i])),
        "min_eigenvalue": finite_or_none(float(found.min_eigenvalue[i])),
        "iterations": int(found.iterations[i]),
    }


def _of_motion(states: SystemMotion, i: int) -> dict[str, Any]:
    """The energies [J]: kinetic + potential + dissipated − supplied is constant but for the steps' error."""
    found = states.trajectories
    energies = {
        name: float(getattr(found, name)[i]) for name in ("kinetic", "potential", "dissipated", "supplied")
    }
    return {"converged": bool(found.converged[i]), "energies": energies, "steps": int(found.steps[i])}

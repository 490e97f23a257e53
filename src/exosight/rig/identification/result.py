"""A rig's model from its pictures: fit, intervals, what stays open, which picture next, the system file."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import tomli_w
from jaxtyping import Float

from exosight.errors import ConvergenceError
from exosight.rig.identification.fit import Problem, fit, refitted
from exosight.rig.identification.measurements import Measurements
from exosight.rig.identification.parameters import Prior, complete, parameters_of, values_at
from exosight.rig.identification.posterior import (
    Estimate,
    OpenDirection,
    Posterior,
    estimates,
    information_gains,
    open_directions,
    posterior,
)
from exosight.rig.identification.response import Model, followed
from exosight.system.file import Values

CANDIDATES = 16
"""Commands of which each channel's most telling is looked for, evenly over its range as it was used."""
SAME_POSE = 1e-4
"""Largest difference of coordinates of one pose that is found in two ways."""


@dataclass(frozen=True)
class Identification:
    """What pictures tell of a rig.

    values       entries of the fitted system file
    estimates    parameters with their intervals
    open         directions that the data do not tell
    commands     (candidates, channels)   of a further picture
    gains        (candidates,)            information that it would give [nats]
    posterior
    rested       whether the search ended because nothing more was to gain
    elsewhere    numbers of pictures, from 0, whose pose is not the one that the path from rest leads to
    """

    values: Values
    estimates: tuple[Estimate, ...]
    open: tuple[OpenDirection, ...]
    commands: Float[np.ndarray, "candidates channels"]
    gains: Float[np.ndarray, " candidates"]
    posterior: Posterior
    rested: bool
    elsewhere: tuple[int, ...]

    def named(self, name: str) -> Values:
        """The file under another name, with the 95 % intervals of its bodies as what varies."""
        vary = [
            {"entry": each.entry, "low": f"{each.low!r} {each.unit}", "high": f"{each.high!r} {each.unit}"}
            for each in self.estimates
            if each.entry.startswith(("rods.", "links."))
        ]
        return {**self.values, "name": name, "vary": vary}

    @property
    def toml(self) -> str:
        """The fitted system file."""
        return tomli_w.dumps(self.values)


def identify(
    values: Values,
    measured: Measurements,
    prior: Prior | None = None,
    known_gains: bool = True,
    done: Callable[[int], None] = lambda pictures: None,
) -> Identification:
    """The model of a rig that explains its pictures and readings best.

    values        entries of the system file to start from, see `read_system_file` and `index_values`
    known_gains   whether the file's gains are certain
    done          called with the number of pictures taken in so far

    Raises InputError for fewer than two pictures or commands, a system with friction or readings of sensors
    that it has not; ConvergenceError where no pose is found.
    """
    measured.check_identifiable()
    prior = Prior() if prior is None else prior
    values = complete(values)
    problem = Problem(Model(values, parameters_of(values, prior, known_gains)), measured, prior)
    state, rested = fit(problem, done)
    path, stable = followed(problem.numbers(state.x).system, problem.commands)
    if not stable.all():
        raise ConvergenceError(
            f"no stable pose of the fitted system at the command of picture {int(np.argmin(stable)) + 1}"
        )
    if np.abs(path - state.q).max() > SAME_POSE:
        state, rested = refitted(problem, state)
        path, _ = followed(problem.numbers(state.x).system, problem.commands)
    known = posterior(problem, state)
    commands = _candidates(problem.commands)
    return Identification(
        values=values_at(values, problem.model.parameters, state.x[: len(problem.model.parameters)]),
        estimates=estimates(problem, known),
        open=open_directions(problem, known),
        commands=commands,
        gains=information_gains(problem, known, commands),
        posterior=known,
        rested=rested,
        elsewhere=tuple(np.flatnonzero(np.abs(path - state.q).max(axis=1) > SAME_POSE).tolist()),
    )


def _candidates(commands: Float[np.ndarray, "pictures channels"]) -> Float[np.ndarray, "candidates channels"]:
    """Commands on the way from none to the largest ones used, channel by channel."""
    shares = np.arange(1, CANDIDATES + 1)[:, None] / CANDIDATES
    found = []
    for channel in range(commands.shape[1]):
        largest = commands[np.argmax(np.abs(commands[:, channel])), channel]
        if largest:
            row = np.zeros((1, commands.shape[1]))
            row[0, channel] = largest
            found.append(shares * row)
    return np.concatenate(found)

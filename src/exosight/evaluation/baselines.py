"""How well sensors are known without an image: what an estimator has to beat."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from pydantic import JsonValue

from exosight.dataset import Frames, Manifest, Split
from exosight.dataset.frames import direction
from exosight.evaluation.metrics import Scores, score
from exosight.evaluation.published import is_published
from exosight.exosuit.shapes import radius, shape_from_dict
from exosight.system.design import Design
from exosight.system.units import split_quantity

BINS = 40
"""Frames count as of one command within this share of its channel's peak."""
PLACES = np.linspace(0, 1, 6)
"""Where along an exosuit of the published system its radius is known."""
NEIGHBOURS = 4
"""Training designs that a design is compared with, and training frames that several commands are."""


def evaluate_baselines(frames: Frames, split: Split, manifest: Manifest) -> dict[str, Scores]:
    """Score baselines on the test part, each made from the training part alone.

    mean of training   the mean training labels, always; alone where the system has no channel
    u only             of one channel u: the mean training labels at this command, interpolated in bins of
                       a 40th of its peak; it knows whether the command rises or falls, which no single image
                       shows. Of several ("commands only"): the mean of the four training frames whose
                       commands are nearest
    … and geometry     of one channel: the labels of the four training designs that are nearest, interpolated
                       at this command, weighted by 1 / distance²; in the published system nearest in length
                       and in radius at six places, in others ("… and design") in what varies
    """
    schema = frames.schema
    known = _labels(frames)
    train, test = known.pick(split.train), known.pick(split.test)
    answers = {"mean of training": np.tile(train.labels.mean(axis=0), (len(split.test), 1))}
    if len(schema.channels) > 1:
        answers["commands only"] = _nearest(train, test)
    elif schema.channels:
        channel = schema.channels[0]
        answers[f"{channel.name} only"] = _along(_binned(train, abs(channel.peak) / BINS), test)
        of_shape = is_published(schema)
        sizes = {design.number: _sizes(design, of_shape) for design in manifest.designs}
        if all(sizes.values()):
            name = f"{channel.name} and {'geometry' if of_shape else 'design'}"
            answers[name] = _by_design(train, test, sizes)
    return {name: score(schema, test.labels, answer) for name, answer in answers.items()}


@dataclass(frozen=True)
class _Labels:
    """Frames without images."""

    commands: Float[np.ndarray, "frames channels"]
    direction: Int[np.ndarray, " frames"]
    design: Int[np.ndarray, " frames"]
    labels: Float[np.ndarray, "frames outputs"]

    def pick(self, index: Int[np.ndarray, " picked"]) -> "_Labels":
        return _Labels(self.commands[index], self.direction[index], self.design[index], self.labels[index])


def _labels(frames: Frames) -> _Labels:
    return _Labels(frames.commands, direction(frames), frames.design, frames.labels)


def _nearest(train: _Labels, test: _Labels) -> Float[np.ndarray, "frames outputs"]:
    scale = np.maximum(np.abs(train.commands).max(axis=0), 1e-12)
    out = np.zeros_like(test.labels, dtype=float)
    for i, commands in enumerate(test.commands):
        distance = np.abs((train.commands - commands) / scale).max(axis=1)
        out[i] = train.labels[np.argsort(distance, kind="stable")[:NEIGHBOURS]].mean(axis=0)
    return out


def _binned(train: _Labels, width: float) -> _Labels:
    """Mean labels in each bin of the command and each direction, as frames of no design."""
    keys = np.stack([np.rint(train.commands[:, 0] / width).astype(int), train.direction], axis=1)
    bins, which = np.unique(keys, axis=0, return_inverse=True)
    count = np.bincount(which.ravel())
    means = np.stack([np.bincount(which.ravel(), column) / count for column in train.labels.T], axis=1)
    return _Labels(width * bins[:, :1], bins[:, 1], np.full(len(bins), -1), means)


def _sizes(design: Design, of_shape: bool) -> tuple[float, ...]:
    """Numbers by which designs are compared; none where a parameter is no number."""
    if of_shape:
        shape = shape_from_dict({name: x for name, x in design.parameters.items() if name != "seed"})
        return (*radius(shape.surface, PLACES).tolist(), shape.length)
    numbers = [_number(value) for value in design.parameters.values()]
    return tuple(number for number in numbers if number is not None) if None not in numbers else ()


def _number(value: JsonValue) -> float | None:
    """A number, or that of a quantity such as "45 mm"; those of one entry share their unit."""
    if isinstance(value, str):
        try:
            return split_quantity(value, "45 mm")[0]
        except ValueError:
            return None
    return float(value) if isinstance(value, int | float) else None


def _by_design(
    train: _Labels, test: _Labels, sizes: dict[int, tuple[float, ...]]
) -> Float[np.ndarray, "frames outputs"]:
    known = np.unique(train.design)
    of_known = np.array([sizes[design] for design in known.tolist()])
    scale = np.where(np.ptp(of_known, axis=0) > 0, of_known.std(axis=0), 1.0)
    paths = [train.pick(np.flatnonzero(train.design == design)) for design in known]
    out = np.zeros(test.labels.shape)
    for design in np.unique(test.design):
        squared = (((of_known - sizes[int(design)]) / scale) ** 2).sum(axis=1)
        nearest = np.argsort(squared, kind="stable")[:NEIGHBOURS]
        # A design that was learned from is its own neighbour and then has nearly all the weight.
        weights = 1 / (squared[nearest] + 1e-9)
        here = np.flatnonzero(test.design == design)
        for neighbour, weight in zip(nearest, weights / weights.sum(), strict=True):
            out[here] += weight * _along(paths[neighbour], test.pick(here))
    return out


def _along(path: _Labels, asked: _Labels) -> Float[np.ndarray, "frames outputs"]:
    """The path's labels where it was loaded in the direction asked for (or in any, if it never was)."""
    out = np.zeros(asked.labels.shape)
    for way in (1, -1):
        here, alike = (np.flatnonzero(labels.direction == way) for labels in (asked, path))
        part = path.pick(alike) if len(alike) else path
        order = np.argsort(part.commands[:, 0], kind="stable")
        for column, values in enumerate(part.labels[order].T):
            out[here, column] = np.interp(asked.commands[here, 0], part.commands[order, 0], values)
    return out

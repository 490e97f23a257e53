"""How well the forces can be told without a picture: what an estimator that looks has to beat."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from exosight.dataset import Frames, Manifest, Split, sampled_shapes
from exosight.evaluation.metrics import Scores, score
from exosight.exosuit.shapes import radius

BIN = 0.1
"""Frames count as of one actuation within this [N]."""
PLACES = np.linspace(0, 1, 6)
"""Where along an exosuit its radius is known."""
NEIGHBOURS = 4
"""Training shapes that an exosuit is compared with."""


def evaluate_baselines(frames: Frames, split: Split, manifest: Manifest) -> dict[str, Scores]:
    """Score three baselines on the test part, each made from the training part alone.

    mean of training  the mean training forces, always
    u only            the mean training forces at this actuation, interpolated between bins of 0.1 N
    u and geometry    the forces of the four training shapes whose radius at six places and length are
                      nearest, interpolated at this actuation, weighted by 1 / distance²

    The last two know whether the actuation rises or falls, which no single picture shows.
    """
    train, test = _pick(frames, split.train), _pick(frames, split.test)
    answers = {
        "mean of training": np.tile(train.forces.mean(axis=0), (len(test.u), 1)),
        "u only": _along(_binned(train), test),
        "u and geometry": _by_geometry(train, test, manifest),
    }
    return {name: score(test.forces, answer) for name, answer in answers.items()}


@dataclass(frozen=True)
class _Labels:
    """Frames without pictures."""

    u: Float[np.ndarray, " frames"]
    loading: Int[np.ndarray, " frames"]
    shape_id: Int[np.ndarray, " frames"]
    forces: Float[np.ndarray, "frames 7"]


def _pick(frames: Frames | _Labels, index: Int[np.ndarray, " picked"]) -> _Labels:
    return _Labels(frames.u[index], frames.loading[index], frames.shape_id[index], frames.forces[index])


def _binned(train: _Labels) -> _Labels:
    """Mean forces in each bin of u and each direction, as frames of no shape."""
    keys = np.stack([np.rint(train.u / BIN).astype(int), train.loading], axis=1)
    bins, which = np.unique(keys, axis=0, return_inverse=True)
    count = np.bincount(which.ravel())
    means = np.stack([np.bincount(which.ravel(), column) / count for column in train.forces.T], axis=1)
    return _Labels(BIN * bins[:, 0], bins[:, 1], np.full(len(bins), -1), means)


def _by_geometry(train: _Labels, test: _Labels, manifest: Manifest) -> Float[np.ndarray, "frames 7"]:
    shapes = sampled_shapes(manifest)
    sizes = {each.shape_id: (*radius(each.shape.surface, PLACES), each.shape.length) for each in shapes}
    known = np.unique(train.shape_id)
    of_known = np.array([sizes[shape] for shape in known.tolist()])
    scale = np.where(np.ptp(of_known, axis=0) > 0, of_known.std(axis=0), 1.0)
    paths = [_pick(train, np.flatnonzero(train.shape_id == shape)) for shape in known]
    out = np.zeros((len(test.u), 7))
    for shape in np.unique(test.shape_id):
        squared = (((of_known - sizes[int(shape)]) / scale) ** 2).sum(axis=1)
        nearest = np.argsort(squared, kind="stable")[:NEIGHBOURS]
        # A shape that was learned from is its own neighbour and then has nearly all the weight.
        weights = 1 / (squared[nearest] + 1e-9)
        here = np.flatnonzero(test.shape_id == shape)
        for neighbour, weight in zip(nearest, weights / weights.sum(), strict=True):
            out[here] += weight * _along(paths[neighbour], _pick(test, here))
    return out


def _along(path: _Labels, asked: _Labels) -> Float[np.ndarray, "frames 7"]:
    """The path's forces where it was loaded in the direction asked for (or in any, if it never was)."""
    out = np.zeros((len(asked.u), 7))
    for way in (1, -1):
        here, alike = (np.flatnonzero(labels.loading == way) for labels in (asked, path))
        part = _pick(path, alike) if len(alike) else path
        order = np.argsort(part.u, kind="stable")
        for column, forces in enumerate(part.forces[order].T):
            out[here, column] = np.interp(asked.u[here], part.u[order], forces)
    return out

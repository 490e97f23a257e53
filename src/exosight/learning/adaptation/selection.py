"""A network adapted by what cross-validation finds best.

Tried are the methods of `adaptation.methods`, each on pictures as they are and on pictures registered to the
former camera. What cross-validation predicts for the pictures that it leaves out also says how wide
intervals must be.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float32

import exosight
from exosight.errors import InputError
from exosight.learning.adaptation.labelled import Labelled, features, folds, joined
from exosight.learning.adaptation.methods import FEWEST_FOR_ALL, METHODS, Method, fit
from exosight.learning.adaptation.view import View, through
from exosight.learning.causes import CauseClassifier
from exosight.learning.intervals import Widths, calibrate_intervals
from exosight.learning.large_error import LargeError
from exosight.learning.model_file import ModelCard
from exosight.learning.networks import SensorModel, build_network
from exosight.learning.ood import OodDetector, refit_ood_detector
from exosight.learning.outputs import auxiliary_units, nonnegative
from exosight.learning.pretrained import Pretrained, as_model
from exosight.learning.registration import Homography
from exosight.learning.training_data import offset_of, scale_of
from exosight.system.schema import Schema

FEWEST = 4
"""Labels with which cross-validation begins, and pictures that tell what is usual."""
_FOLDS = 5
_NORMALISING = 512
"""Pictures that set what a network is normalised by."""

Way = tuple[Method, bool]
"""A method, and whether pictures are registered."""


@dataclass(frozen=True)
class Candidate:
    """One way to adapt."""

    method: Method
    registered: bool
    """whether pictures are registered to the former camera"""
    error: float | None
    """root mean square error by cross-validation, each output in units of its scale; None without labels"""


@dataclass(frozen=True)
class Adaptation:
    """An adapted network, and how it came about."""

    model: SensorModel
    ood: OodDetector
    causes: CauseClassifier | None
    """as before"""
    card: ModelCard
    chosen: Candidate
    candidates: tuple[Candidate, ...]
    """all that were tried"""


def adapt(
    pretrained: Pretrained,
    schema: Schema,
    labelled: Labelled,
    others: Labelled,
    about: Mapping[str, str | int | float],
    *,
    method: Method | Literal["auto"] = "auto",
    seed: int = 0,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Adaptation:
    """Adapt a network to pictures of another set-up.

    schema     of the new data: the sensors to estimate, which may be others than the former ones
    labelled   pictures whose labels may be used; cross-validation leaves out whole sequences of them
    others     further pictures of the set-up, whose labels are not looked at: they tell how the camera has
               moved, and which pictures are usual
    about      identity of the data, which the network keeps
    method     "auto": chosen by cross-validation

    Raises InputError for pictures of another size, other inputs, too few labels or pictures, or sensors that
    the former network did not estimate and that have no labels.
    """
    known = _same_outputs(pretrained.card.schema, schema)
    pictures = joined(labelled, others)
    _check(pretrained.card, schema, len(labelled), len(pictures), method, known)
    start = _start(pretrained, schema, labelled, pictures, known)
    former = torch.tensor(pretrained.card.registration) if pretrained.card.registration else None
    view = View(pretrained.ood, start, pictures, former, seed, known)
    result = _Result(pretrained, schema, pictures, {**about, "labels": len(labelled)})
    if not len(labelled):
        homography = view.without_labels()
        return result.of(start, homography, Candidate("none", homography is not former, None))

    parts = folds(labelled.sequence, _FOLDS)
    # Of ten labels two are left out at a time, too little to overrule what all pictures say: where the OOD
    # score had found the camera moved, r was 0.89 with registration, 0.72 with the last layer without it.
    surely = len(labelled) < FEWEST_FOR_ALL and view.without_labels() is not former
    views = (True,) if surely else (False, True)
    ways: list[Way] = [(name, moved) for name in _methods(method, len(labelled), known) for moved in views]
    done = 0

    def fitted(way: Way, part: Labelled, moved: Homography) -> tuple[SensorModel, Homography | None]:
        nonlocal done
        homography = moved if way[1] else former
        model = fit(way[0], start, through(homography, part), seed)
        done += 1
        progress(done, len(ways) * len(parts) + 1)
        return model, homography

    empty = np.empty_like(labelled.labels)
    found = {way: (empty.copy(), empty.copy()) for way in ways}
    for rows in parts:
        part, left = labelled.without(rows), labelled.take(rows)
        moved = view.with_labels(part)
        for way in ways:
            model, homography = fitted(way, part, moved)
            for kept, answer in zip(found[way], _read(model, through(homography, left)), strict=True):
                kept[rows] = answer
    errors = {way: values - labelled.labels for way, (values, _) in found.items()}
    rms = {way: float(np.sqrt(np.mean((e / start.scale.numpy()) ** 2))) for way, e in errors.items()}
    tried = {way: Candidate(*way, error) for way, error in rms.items()}
    best = min(rms, key=lambda way: rms[way])
    return result.of(
        *fitted(best, labelled, view.with_labels(labelled)),
        tried[best],
        tuple(tried.values()),
        widths=calibrate_intervals(*found[best], labelled.labels, nonnegative(schema)),
        validation_l1=float(np.abs(errors[best]).mean()),
    )


@dataclass(frozen=True)
class _Result:
    """What an adapted network keeps beside its weights."""

    pretrained: Pretrained
    schema: Schema
    pictures: Labelled
    about: dict[str, str | int | float]

    def of(
        self,
        model: SensorModel,
        homography: Homography | None,
        chosen: Candidate,
        candidates: tuple[Candidate, ...] = (),
        widths: Widths | None = None,
        validation_l1: float | None = None,
    ) -> Adaptation:
        """Without labels intervals are as wide as before, and the detector is the former one.

        The probability of a large error follows the width of the intervals; other sensors have none.
        """
        former = self.pretrained.card
        seen = through(homography, self.pictures)
        ood = self.pretrained.ood
        if candidates:
            ood = refit_ood_detector(model, ood, (seen.images, seen.commands))
        card = replace(
            former,
            exosight_version=exosight.__version__,
            schema=self.schema,
            validation_l1=former.validation_l1 if validation_l1 is None else validation_l1,
            training={**former.training, "adapted": chosen.method, "adapted_from": self.pretrained.sha256},
            data=dict(self.about),
            widths=widths or former.widths,
            ood_limit=ood.limit,
            large_error=_large_error(former, self.schema, widths),
            registration=() if homography is None else tuple(homography.tolist()),
        )
        return Adaptation(model, ood, self.pretrained.causes, card, chosen, candidates)


def _large_error(former: ModelCard, schema: Schema, widths: Widths | None) -> LargeError | None:
    """The former one, of errors as much larger as intervals have become wider."""
    large = former.large_error
    if large is None or not _same_outputs(former.schema, schema):
        return None
    if widths is None:
        return large
    wider = np.array(widths.estimated_force) / np.maximum(former.widths.estimated_force, 1e-9)
    ratio = float(np.median(np.maximum(wider, 1e-9)))
    return replace(large, bias=large.bias + large.error * math.log(ratio))


def _check(card: ModelCard, schema: Schema, labels: int, pictures: int, method: str, known: bool) -> None:
    if card.schema.image_size != schema.image_size:
        (height, width), (rows, columns) = card.schema.image_size, schema.image_size
        raise InputError(
            f"data: expected pictures of the network's size, {width}×{height} pixels, got {columns}×{rows}; "
            f"import them with --size {width} {height}, or adapt a network of their size"
        )
    if card.actuation and card.schema.channels != schema.channels:
        names = ", ".join(f"{channel.name} [{channel.unit}]" for channel in card.schema.channels)
        raise InputError(
            f"data: expected the commands that are an input of the network, {names}, got others; adapt a "
            "network that reads pictures alone"
        )
    if pictures < FEWEST:
        raise InputError(
            f"data: expected at least {FEWEST} pictures beside those for testing, got {pictures}"
        )
    if labels and labels < FEWEST:
        raise InputError(
            f"labels: expected 0, or at least {FEWEST}, so that some can be left out in turn, got {labels}"
        )
    if not labels and method not in ("auto", "none"):
        raise InputError(f"method: {method} needs labels, got none; give --labels, or leave the method out")
    if not known and (not labels or method in ("none", "affine")):
        raise InputError(
            f"data: the network estimates {', '.join(card.schema.outputs)}, the data have "
            f"{', '.join(schema.outputs)}; other sensors need labels, and the method last or all"
        )


def _same_outputs(former: Schema, schema: Schema) -> bool:
    """Whether a network's answers are what the labels are of."""
    mine, others = ([(s.name, s.unit) for s in of.estimated] for of in (former, schema))
    return mine == others


def _methods(method: Method | Literal["auto"], labels: int, known: bool) -> tuple[Method, ...]:
    if method != "auto":
        return (method,)
    own = METHODS if known else METHODS[2:]
    return own if labels >= FEWEST_FOR_ALL else own[:-1]


def _start(
    pretrained: Pretrained, schema: Schema, labelled: Labelled, pictures: Labelled, known: bool
) -> SensorModel:
    """The former network, its last layer begun anew where the outputs are others."""
    card = pretrained.card
    few = pictures.take(np.arange(0, len(pictures), -(-len(pictures) // _NORMALISING)))
    former = as_model(pretrained, *few.tensors())
    if known:
        return former
    scale = scale_of(labelled.labels, [sensor.unit for sensor in schema.estimated])
    own = build_network(
        card.network, schema, len(auxiliary_units(schema)), card.seed, card.history, card.actuation
    )
    whole = {**former.network.state_dict()}
    for name, tensor in own.last.state_dict().items():
        whole[f"{len(own) - 1}.{name}"] = torch.zeros_like(tensor)
    own.load_state_dict(whole)
    offsets = offset_of(labelled.labels, schema)
    return SensorModel(
        own,
        torch.from_numpy(scale).float(),
        nonnegative(schema),
        torch.tensor(offsets, dtype=torch.float32) if offsets else None,
    ).eval()


def _read(
    model: SensorModel, seen: Labelled
) -> tuple[Float32[np.ndarray, "frames outputs"], Float32[np.ndarray, "frames outputs"]]:
    """Values, and the errors to be expected of them [the sensors' units]."""
    with torch.inference_mode():
        values, error, _ = model.read(features(model, seen))
    return values.numpy(), error.numpy()

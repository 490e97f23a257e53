"""Sensors estimated from images: the interface that control uses, and the trained network behind it."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Float32, UInt8

from exosight.errors import DataError, InputError
from exosight.learning.intervals import interval
from exosight.learning.large_error import NOT_SHOWN, error_probability
from exosight.learning.model_file import OUTPUTS, ModelCard, images_at_once, open_model
from exosight.learning.model_inputs import IMAGE_ONLY, ModelInputs, check_inputs, stacked
from exosight.learning.outputs import nonnegative
from exosight.system.schema import Schema, network_difference
from exosight.vision.pictures import CameraCrop

_MODELS = Path(__file__).parents[1] / "models"

DEFAULT_MODEL = _MODELS / "light.onnx"
"""The network that comes with the package for the published system; the cards of all lie beside it."""

SHIPPED_MODELS = {
    "published": DEFAULT_MODEL,
    "index": _MODELS / "index.onnx",
    "index-friction": _MODELS / "index-friction.onnx",
}
"""The networks that come with the package, by the system that they are for."""

NAMED_MODELS = {name: _MODELS / f"{name}.onnx" for name in ("index", "index-control", "index-photo")}
"""Networks that come with the package, by the name that options call them by: that of `index` for systems of
other names, such as an identified rig; for closed loops, with u beside the picture; and for photographs."""

SHIPPED = "shipped"
"""What options call the network of the package for the system at hand."""


def model_path(given: Path | None, system: str | Schema) -> Path:
    """The file of a network: as given, one of NAMED_MODELS by its name, or the package's own for a system.

    The last where it is left out or "shipped". For a system that the package has no network for it is the
    first that estimates the same sensors through the same cameras, where all of the schema is known, as an
    identified rig's; else the published system's, which then does not fit it.
    """
    if given is not None and str(given) != SHIPPED:
        return NAMED_MODELS.get(str(given), given)
    name = system.system if isinstance(system, Schema) else system
    if name not in SHIPPED_MODELS and isinstance(system, Schema):
        for path in dict.fromkeys(SHIPPED_MODELS.values()):
            if network_difference(open_model(path, 1)[1].schema, system) is None:
                return path
    return SHIPPED_MODELS.get(name, DEFAULT_MODEL)


def model_name(path: Path) -> str:
    """What results call a network: its path, or of the package's own the name of its file."""
    return path.name if path.parent == _MODELS else str(path)


CROP = "crop"
"""Entry of a card's data: size of the pictures that were imported, and the part that was taken."""

_LARGEST = 1e20
"""Of what a network answers: no interval or share of a limit made from it overflows."""


@runtime_checkable
class Estimator(Protocol):
    """Sensors from images; all that control needs of an estimator."""

    def estimate(
        self, images: UInt8[np.ndarray, "frames height width"]
    ) -> Float32[np.ndarray, "frames outputs"]:
        """The estimated sensors of a schema [their units], one row an image."""
        ...


@dataclass(frozen=True)
class Reading:
    """What a network estimates from images, one row an image."""

    forces: Float32[np.ndarray, "frames outputs"]
    """the estimated sensors of the card's schema [their units]"""
    low: Float32[np.ndarray, "frames outputs"]
    """lower end of the interval [their units]"""
    high: Float32[np.ndarray, "frames outputs"]
    """upper end [their units]"""
    contact: Float32[np.ndarray, "frames outputs"]
    """probability that there is contact [-]; 0 for a sensor that is not a force"""
    ood_score: Float32[np.ndarray, " frames"]
    """OOD score of each image as a share of its limit: above 1, it is out of distribution"""
    error_probability: Float32[np.ndarray, " frames"] | None = None
    """probability that the error of each is large, as the card's `large_error` has it [-]; None without"""
    causes: Float32[np.ndarray, "frames causes"] | None = None
    """probability of each of the card's causes that an image is unusual [-]; None if it names none"""


@runtime_checkable
class Reader(Protocol):
    """An estimator with intervals and OOD scores; all that a guard needs."""

    def read(self, images: np.ndarray, level: float = 0.9) -> Reading:
        """Values, intervals, contact and OOD score of each image."""
        ...


Read = Callable[[UInt8[np.ndarray, "frames height width"]], Reading]
"""What reads images alone: `OnnxEstimator.read` of a network that takes nothing beside."""


def is_frame(image: object) -> bool:
    """Whether it is a gray image, uint8 (height, width), that is not empty."""
    return isinstance(image, np.ndarray) and image.dtype == np.uint8 and image.ndim == 2 and image.size > 0


def read_one(read: Callable[[UInt8[np.ndarray, "1 height width"]], Reading], image: object) -> Reading | None:
    """What a network reads off one image; None if it is no image, or not one of the network's, or if the
    network answers no finite number, which is no answer."""
    if not isinstance(image, np.ndarray) or not is_frame(image):
        return None
    try:
        return read(image[None])
    except (DataError, InputError):
        return None


def takes_commands(estimator: object) -> bool:
    """Whether it is a network that reads an image with the commands that it shows."""
    return isinstance(estimator, OnnxEstimator) and estimator.card.actuation


def read_under(estimator: Reader | Read, commands: Float[np.ndarray, " channels"]) -> Read:
    """What reads an image that was taken under these commands; a network that takes commands gets them.

    commands  [each in its channel's unit]
    """
    read = estimator.read if isinstance(estimator, Reader) else estimator
    if takes_commands(estimator):
        return partial(read, inputs=ModelInputs(commands=commands[None].astype(np.float32)))
    return read


def shown_score(score: float | np.floating) -> float:
    """An OOD score to three digits, as it is shown: one above the limit of 1 never reads as 1."""
    return max(round(float(score), 3), 1.001) if score > 1 else round(float(score), 3)


@dataclass(frozen=True)
class OnnxEstimator:
    """A trained network, run by ONNX Runtime on the CPU; needs no PyTorch."""

    session: Any
    """onnxruntime.InferenceSession"""
    card: ModelCard
    """what was trained on what"""

    @staticmethod
    def load(path: Path, threads: int = 1, *, alone: bool = False, history: bool = True) -> "OnnxEstimator":
        """Open an estimator that `export_onnx` wrote.

        threads   for one image at 10 Hz one thread is plenty, and leaves the other cores to the plant
        alone     whether it will be shown one image and nothing beside
        history   whether it will be shown earlier images

        Raises DataError if the file is missing, truncated, changed, or no estimator of exosight; InputError
        if it asks for more than it will be shown.
        """
        session, card = open_model(path, threads)
        if alone and (card.history or card.actuation):
            raise InputError(
                f"{path}: expected a network that reads one image alone, got one that asks for history "
                f"{card.history} and actuation {card.actuation}; give OnnxEstimator.read its ModelInputs, "
                "use exosight evaluate or control, or choose another network"
            )
        if card.history and not history:
            raise InputError(
                f"{path}: expected a network that reads one image, with or without commands, got one that "
                f"asks for history {card.history}; choose another network"
            )
        return OnnxEstimator(session, card)

    @property
    def crop(self) -> CameraCrop | None:
        """The part that was taken of the pictures that it learned from, for pictures of that camera.

        Raises DataError if its file says something else.
        """
        if CROP not in self.card.data:
            return None
        try:
            taken = json.loads(str(self.card.data[CROP]))
            columns, rows, left, top, width, _ = (*map(int, taken["picture"]), *map(int, taken["part"]))
        except (KeyError, TypeError, ValueError) as error:
            raise DataError("model: its file names no part of a picture; train it again") from error
        return CameraCrop((rows, columns), (left, top, width))

    def estimate(
        self, images: np.ndarray, inputs: ModelInputs = IMAGE_ONLY
    ) -> Float32[np.ndarray, "frames outputs"]:
        """The estimated sensors [their units], one row an image; arguments and errors as for `read`."""
        return self.read(images, inputs=inputs).forces

    def read(self, images: np.ndarray, level: float = 0.9, inputs: ModelInputs = IMAGE_ONLY) -> Reading:
        """Values, intervals and contact.

        images    (frames, height, width)  uint8 gray values, of the size that the network was trained on
        level     share of images, of the kind that the network was calibrated with, whose true value is to
                  lie in its interval: one of `exosight.learning.intervals.LEVELS`
        inputs    earlier images and commands, where its card says so

        Raises InputError for images of another type or size, or other inputs; DataError if the network
        answers no number.
        """
        return self.read_levels(images, (level,), inputs)[level]

    def read_levels(
        self, images: np.ndarray, levels: Sequence[float], inputs: ModelInputs = IMAGE_ONLY
    ) -> dict[float, Reading]:
        """The same with the intervals of several levels, for the work of one: level → reading."""
        card, size = self.card, self.card.schema.image_size
        if images.dtype != np.uint8 or images.ndim != 3 or images.shape[1:] != size:
            raise InputError(
                f"images: this estimator needs uint8 (frames, {size[0]}, {size[1]}), got {images.dtype} "
                f"{images.shape}; render or resize them to {size[0]}×{size[1]} pixels"
            )
        check_inputs(images, inputs, card.history, card.channels)
        found = np.empty((3, len(images), len(card.schema.outputs)), np.float32)
        ood_score = np.empty(len(images), np.float32)
        causes = np.zeros((len(images), len(card.causes)), np.float32)
        together = images_at_once(*size)
        for start in range(0, len(images), together):
            part = slice(start, start + together)
            own = ModelInputs(*(None if x is None else x[part] for x in (inputs.history, inputs.commands)))
            given = {"image": stacked(images[part], own).astype(np.float32) / np.float32(255)}
            if own.commands is not None:
                given["commands"] = own.commands
            try:
                answers = self.session.run(list(card.outputs), given)
            except Exception as error:  # its exceptions share no base of their own
                raise DataError(
                    f"the network does not run ({str(error)[:200]}); train and export it again"
                ) from error
            *found[:, part], ood_score[part] = answers[: len(OUTPUTS)]
            if card.causes:
                causes[part] = answers[-1]
        if not all((np.abs(x) <= _LARGEST).all() for x in (found, ood_score, causes)):
            raise DataError("the network answers numbers that are not finite; train and export it again")
        values, expected_error, contact = found
        contact = np.clip(contact, 0, 1)  # a logistic function in single precision may pass 1 by its last bit
        ood_score /= np.float32(card.ood_limit)
        forced = nonnegative(card.schema)
        likely = None
        if card.large_error:
            likely = error_probability(card.large_error, card.schema, expected_error, ood_score)
            if NOT_SHOWN in card.causes:  # then whatever is estimated is wrong
                likely = 1 - (1 - likely) * (1 - causes[:, card.causes.index(NOT_SHOWN)])
            likely = likely.astype(np.float32)
        beside = likely, np.clip(causes, 0, 1) if card.causes else None
        return {
            level: Reading(
                values,
                *interval(card.widths, level, values, expected_error, forced),
                contact,
                ood_score,
                *beside,
            )
            for level in levels
        }

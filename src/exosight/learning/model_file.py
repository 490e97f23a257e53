"""The ONNX file of an estimator: what its metadata say, its seal, and opening it; usable without PyTorch.

The seal is one more metadata entry at the very end of the file, a SHA-256 of all bytes before it. Protocol
buffers may be continued by appending, so any ONNX reader sees an ordinary model. It tells damage, not trust:
whoever changes a file can seal it again, so all that is in it is checked before it is used.
"""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import pydantic
import pydantic_core

from exosight.errors import DataError, InputError
from exosight.files import read_file
from exosight.learning.config import History
from exosight.learning.intervals import LEVELS, Widths
from exosight.learning.large_error import LargeError
from exosight.system.schema import Channel, Schema, network_difference, schema_to_dict
from exosight.validation import first_fault

# ModelProto.metadata_props (field 14, 74 bytes) = {key (field 1): "sha256", value (field 2): 64 hex digits}
_SEAL_START = b"\x72\x4a\x0a\x06sha256\x12\x40"


OUTPUTS = ("forces", "expected_error", "contact", "ood_score")
"""Of the network in the file: values of the estimated sensors [their units], the error to be expected of
each, probability of contact; and one number an image, its OOD score."""

CAUSES = "causes"
"""One more output of networks whose card names causes: probabilities of what is unusual about an image."""


BATCH = 64
"""Images of up to 128×128 pixels that a network answers at once, see `images_at_once`."""


def images_at_once(height: int, width: int) -> int:
    """So many of this size that the networks' layers hold a gigabyte at most: 64 of 128×128 pixels.

    Of these the paper network's first layer takes 260 MB. At least one.
    """
    return max(1, min(BATCH, BATCH * 128**2 // (height * width)))


Text = Annotated[str, pydantic.Field(max_length=10_000, pattern=r"^[^\x00-\x1f\x7f-\x9f]*$")]
Finite = Annotated[float, pydantic.Field(allow_inf_nan=False)]
Count = Annotated[int, pydantic.Field(ge=0, lt=2**63)]
_WIDEST = 1e9  # expected errors
_LARGEST_FILE = 2**31 - 1  # bytes: no protocol buffer is larger
_LARGEST_CARD = 2**20  # letters; of 1024 sensors it has a third of it


@dataclass(frozen=True)
class ModelCard:
    """What travels with a network for its whole life, one metadata entry a field.

    Raises ValueError if its widths are not rising numbers, a row a level, for the sensors that its schema
    estimates.
    """

    exosight_version: Text
    network: Text
    seed: Count
    schema: Schema
    """of the system: its estimated sensors are the outputs, its first camera gives the image size"""
    input: Text
    epoch: Count
    """of the training, the one with the lowest validation loss"""
    validation_l1: Annotated[Finite, pydantic.Field(ge=0)]
    """mean absolute error on the validation part [the outputs' unit]"""
    training: dict[Text, Text | int | Finite | bool]
    """the settings of the training run"""
    data: dict[Text, Text | int | Finite]
    """identity of the frames learned from, camera included"""
    widths: Widths
    """of the intervals around its estimates"""
    ood_limit: Annotated[float, pydantic.Field(ge=1e-3, le=1e6)]
    """score beyond which an image is out of distribution"""
    large_error: LargeError | None = None
    """what counts as a large error, and how probable it is; None where too few frames told"""
    causes: Annotated[tuple[Text, ...], pydantic.Field(max_length=16)] = ()
    """what an image may differ by, as the output `causes` has them; none without that output"""
    history: History = 0
    """earlier images that are inputs beside the one it reads, as further channels, the newest first"""
    actuation: bool = False
    """whether it has a second input, the commands of all channels"""
    registration: Annotated[tuple[Finite, ...], pydantic.Field(max_length=8)] = ()
    """the homography through which it sees pictures, as `exosight.learning.registration` has it: eight
    numbers, or none where it sees them as they are"""

    def __post_init__(self) -> None:
        outputs = len(self.schema.outputs)
        if not outputs:
            raise ValueError("schema: expected a sensor to estimate, got none")
        if len(self.registration) not in (0, 8):
            raise ValueError(f"registration: expected eight numbers or none, got {len(self.registration)}")
        if self.large_error and not set(self.large_error.sensors) <= set(self.schema.controllable):
            raise ValueError("large_error: expected sensors that follow from the estimated ones")
        for kind in ("estimated_zero", "estimated_force"):
            rows = getattr(self.widths, kind)
            if [len(row) for row in rows] != [outputs] * len(LEVELS):
                raise ValueError(f"widths.{kind}: expected {len(LEVELS)} rows of {outputs} numbers")
            if not all(
                0 <= a <= b <= _WIDEST
                for low, high in pairwise((rows[0], *rows))
                for a, b in zip(low, high, strict=True)
            ):
                raise ValueError(
                    f"widths.{kind}: expected numbers from 0 to {_WIDEST:g} that rise with the level"
                )

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Whose commands are an input."""
        return self.schema.channels if self.actuation else ()

    @property
    def outputs(self) -> dict[str, list[int]]:
        """Outputs of the network by name, and their shape after the batch."""
        one = [len(self.schema.outputs)]
        found: dict[str, list[int]] = dict(zip(OUTPUTS, (one, one, one, []), strict=True))
        return found | {CAUSES: [len(self.causes)]} if self.causes else found

    @property
    def inputs(self) -> dict[str, list[int]]:
        """Inputs of the network by name, and their shape after the batch."""
        image = {"image": [1 + self.history, *self.schema.image_size]}
        return {**image, "commands": [len(self.channels)]} if self.actuation else image

    def check_fits(self, schema: Schema, what: str) -> None:
        """Raise InputError if the network does not fit a system, in one sentence that says how they differ.

        Channels count where its inputs depend on them.

        what   has the other schema: "dataset", "plant" …
        """
        driven = self.actuation or self.history > 0
        if fault := network_difference(self.schema, schema, channels=driven):
            raise InputError(
                f"model: the {what} is of another system than the network: {fault}; "
                f"choose another model, or train one for the system {schema.system}"
            )


def card_to_metadata(card: Any) -> dict[str, str]:
    """Spell a card, a dataclass with a schema, as ONNX metadata: text as it is, everything else as JSON."""
    values = asdict(card) | {"schema": schema_to_dict(card.schema)}
    return {key: value if isinstance(value, str) else json.dumps(value) for key, value in values.items()}


def seal(model: bytes) -> bytes:
    """Append the checksum to a serialised ONNX model."""
    return model + _SEAL_START + hashlib.sha256(model).hexdigest().encode()


def sealed(data: bytes) -> str:
    """The SHA-256 at the end of a sealed model: identifies it."""
    return data[-64:].decode()


def open_model(path: Path, threads: int) -> tuple[Any, ModelCard]:
    """Open a sealed ONNX file for inference on the CPU; nothing in it is executed but ONNX's own operators.

    returns  the onnxruntime.InferenceSession, and what the metadata say

    Raises DataError if it is missing, truncated, changed, or no estimator of exosight.
    """
    return open_session(read_model(path), threads, str(path))


def read_model(path: Path, largest: int = _LARGEST_FILE, what: str = "estimator") -> bytes:
    """The bytes of a sealed ONNX file of at most so many bytes; `what` is what an error calls it.

    Raises DataError if it is missing, truncated, or changed.
    """
    data = read_file(path, largest, f"expected an exported ONNX {what}")
    if seal(data[: -len(_SEAL_START) - 64]) != data:
        article = "an" if what[0] in "aeiou" else "a"
        raise DataError(
            f"{path}: not {article} {what} that exosight exported, or truncated or changed; export it again"
        )
    return data


def open_session(data: bytes, threads: int, name: str) -> tuple[Any, ModelCard]:
    """Open a serialised model; `name` is what an error calls it.

    Raises DataError if the card is not that of an estimator, if the graph holds anything else than what the
    exporter writes, or if ONNX Runtime refuses it; card and graph are checked before it sees them.
    """
    from exosight.learning.model_graph import check_graph, read_graph

    model = read_graph(data, name)
    texts = {entry.key: entry.value for entry in model.metadata_props}
    if "contacts" in texts and "schema" not in texts:
        raise DataError(
            f"{name}: written by an earlier exosight, its card has no schema; make it again: exosight "
            "generate, then exosight train"
        )
    card = read_card(ModelCard, texts, name)
    check_graph(model, card.inputs, card.outputs, len(data), name)
    return run_session(data, threads, name), card


def run_session(data: bytes, threads: int, name: str) -> Any:
    """The onnxruntime.InferenceSession of a serialised model that was checked before.

    Raises DataError if ONNX Runtime refuses it.
    """
    # Set before the import: on Linux it writes a device id to disk, and can report usage.
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 4  # it would print what is raised below
    try:
        return onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # its exceptions share no base of their own
        raise DataError(f"{name}: ONNX Runtime cannot use this model ({str(error)[:200]})") from error


def read_card(kind: type, texts: Mapping[str, str | bytes], name: str, what: str = "estimator") -> Any:
    """The card in a model's metadata, a dataclass, checked to the last field; `what` is what it is of.

    Raises DataError if it is not such a card.
    """
    if not all(isinstance(text, str) for pair in texts.items() for text in pair):  # bytes if not UTF-8
        raise DataError(f"{name}: its card is not text, it was changed; export it again")
    if sum(map(len, texts.values())) > _LARGEST_CARD:
        raise DataError(f"{name}: its card has more than {_LARGEST_CARD >> 20} MiB; export it again")
    kinds = {field.name: field.type for field in fields(kind)}
    try:
        values = {entry: _value(entry, kinds[entry], texts) for entry in kinds.keys() & texts.keys()}
        return _adapter(kind).validate_python(values)
    except pydantic.ValidationError as error:
        fault = first_fault(error)
    except ValueError as error:
        fault = str(error)
    article = "an" if what[0] in "aeiou" else "a"
    raise DataError(
        f"{name}: not {article} {what} of this version of exosight, its card says {fault}; export it again"
    )


@cache
def _adapter(kind: type) -> pydantic.TypeAdapter:
    return pydantic.TypeAdapter(kind)


def _value(name: str, kind: object, texts: Mapping[str, Any]) -> object:
    if kind is Text:
        return texts[name]
    try:
        return pydantic_core.from_json(texts[name], allow_inf_nan=False)
    except ValueError as error:
        raise ValueError(f"{name}: not JSON ({error})") from None

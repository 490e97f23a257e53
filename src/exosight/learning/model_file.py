"""The ONNX file of an estimator: what its metadata say, its seal, and opening it; usable without PyTorch.

The seal is one more metadata entry at the very end of the file, a SHA-256 of all bytes before it. Protocol
buffers may be continued by appending, so any ONNX reader sees an ordinary model.
"""

import hashlib
import json
import os
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import pydantic

from exosight.errors import DataError, InputError
from exosight.learning.config import LONGEST_HISTORY
from exosight.learning.intervals import Widths
from exosight.system.schema import Channel, Schema, network_difference, schema_to_dict

# ModelProto.metadata_props (field 14, 74 bytes) = {key (field 1): "sha256", value (field 2): 64 hex digits}
_SEAL_START = b"\x72\x4a\x0a\x06sha256\x12\x40"


OUTPUTS = ("forces", "expected_error", "contact", "ood_score")
"""Of the network in the file: values of the estimated sensors [their units], the error to be expected of
each, probability of contact; and one number an image, its OOD score."""


@dataclass(frozen=True)
class ModelCard:
    """What travels with a network for its whole life, one metadata entry a field."""

    exosight_version: str
    network: str
    seed: int
    schema: Schema
    """of the system: its estimated sensors are the outputs, its first camera gives the image size"""
    input: str
    epoch: int
    """of the training, the one with the lowest validation loss"""
    validation_l1: float
    """mean absolute error on the validation part [the outputs' unit]"""
    training: dict[str, str | int | float | bool]
    """the settings of the training run"""
    data: dict[str, str | int | float]
    """identity of the frames learned from, camera included"""
    widths: Widths
    """of the intervals around its estimates"""
    ood_limit: float
    """score beyond which an image is out of distribution"""
    history: Annotated[int, pydantic.Field(ge=0, le=LONGEST_HISTORY)] = 0
    """earlier images that are inputs beside the one it reads, as further channels, the newest first"""
    actuation: bool = False
    """whether it has a second input, the commands of all channels"""

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Whose commands are an input."""
        return self.schema.channels if self.actuation else ()

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


_CARD = pydantic.TypeAdapter(ModelCard)


def card_to_metadata(card: ModelCard) -> dict[str, str]:
    """Spell a card as ONNX metadata: text as it is, everything else as JSON."""
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


def read_model(path: Path) -> bytes:
    """The bytes of a sealed ONNX file.

    Raises DataError if it is missing, truncated, or changed.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DataError(
            f"{path}: cannot be read ({error.strerror}); expected an exported ONNX estimator"
        ) from error
    if seal(data[: -len(_SEAL_START) - 64]) != data:
        raise DataError(
            f"{path}: not an estimator that exosight exported, or truncated or changed; export it again"
        )
    return data


def open_session(data: bytes, threads: int, name: str) -> tuple[Any, ModelCard]:
    """Open a serialised model; `name` is what an error calls it.

    Raises DataError if ONNX Runtime refuses the model, if weights lie in another file, or if the card is not
    that of an estimator.
    """
    # Set before the import: on Linux it writes a device id to disk, and can report usage.
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 4  # it would print what is raised below
    # A model may name files that hold its weights: look for them where no file can be.
    options.add_session_config_entry("session.model_external_initializers_file_folder_path", os.devnull)
    try:
        session = onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # its exceptions share no base of their own
        raise DataError(f"{name}: ONNX Runtime cannot use this model ({str(error)[:200]})") from error
    texts = session.get_modelmeta().custom_metadata_map
    if "contacts" in texts and "schema" not in texts:
        raise DataError(
            f"{name}: written by an earlier exosight, its card has no schema; make it again: exosight "
            "generate, then exosight train"
        )
    try:
        named = {field.name for field in fields(ModelCard)} & texts.keys()
        card = _CARD.validate_python({name: _value(name, texts) for name in named})
    except ValueError as error:
        raise DataError(f"{name}: not an estimator of this version of exosight; export it again") from error
    inputs = [(node.name, node.type, node.shape[1:]) for node in session.get_inputs()]
    outputs = [(node.name, node.type, node.shape[1:]) for node in session.get_outputs()]
    shapes = ([len(card.schema.outputs)],) * 3 + ([],)
    wanted = [(name, "tensor(float)", shape) for name, shape in zip(OUTPUTS, shapes, strict=True)]
    if inputs != [(name, "tensor(float)", shape) for name, shape in card.inputs.items()] or outputs != wanted:
        raise DataError(
            f"{name}: inputs {inputs} and outputs {outputs} do not fit its metadata; export it again"
        )
    return session, card


def _value(name: str, texts: dict[str, str]) -> object:
    is_text = ModelCard.__annotations__[name] is str
    return texts[name] if is_text else json.loads(texts[name])

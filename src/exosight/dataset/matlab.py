"""MATLAB's .mat files (version 5, which every MATLAB since 1996 and Octave read): frames, tables of numbers.

Images are height × width × frames, so that `imshow(images(:, :, k))` shows frame k; every other quantity has
a row a frame. Nothing in a .mat file is executed when it is read.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from exosight.dataset.frames import QUANTITIES, Frames, find_fault, row_shapes
from exosight.errors import DataError, InputError
from exosight.files import new_file
from exosight.system.schema import Schema

LARGEST_VARIABLE = 2**31 - 1  # [bytes], a limit of the format
_ANY = 127  # families or scenarios: the arrays alone do not say how many there are
_LONGEST_NAME = 63  # MATLAB's own limit; the format's older one is 31


def write_mat(path: Path, values: Mapping[str, Any]) -> None:
    """Write arrays, texts, lists of texts and structures of these to a new .mat file.

    values   by name; a name must be one in MATLAB

    Raises InputError for a name that MATLAB does not take, or a variable above the format's 2 GiB; DataError
    if the file exists or cannot be written.
    """
    _check(values)
    stored = {name: _storable(value) for name, value in values.items()}
    with new_file(path) as part, part.open("wb") as file:
        scipy.io.savemat(file, stored, do_compression=True, oned_as="column", long_field_names=True)


def read_mat(path: Path) -> dict[str, Any]:
    """What a .mat file holds, by name: arrays as in MATLAB, at least two-dimensional; structures as dict.

    Raises DataError if the file is missing, damaged, or of MATLAB's version 7.3 (`save -v7` writes one that
    can be read).
    """
    try:
        found = scipy.io.loadmat(path, simplify_cells=False, mat_dtype=False, struct_as_record=True)
    except NotImplementedError as error:
        raise DataError(
            f"{path}: a .mat file of version 7.3; save it with the option -v7 of MATLAB's save"
        ) from error
    except OSError as error:
        raise DataError(
            f"{path}: cannot be read ({error.strerror or error}); expected a .mat file"
        ) from error
    except Exception as error:  # whatever SciPy stumbles over in a damaged file
        raise DataError(f"{path}: not a .mat file that can be read, or damaged ({error})") from error
    return {name: _plain(value) for name, value in found.items() if not name.startswith("__")}


def to_matlab(frames: Frames) -> dict[str, np.ndarray]:
    """The arrays of frames as MATLAB wants them, for `write_mat`."""
    values = {name: getattr(frames, name) for name in QUANTITIES}
    return values | {"images": np.transpose(frames.images, (1, 2, 0))}


def from_matlab(values: Mapping[str, Any], schema: Schema) -> Frames:
    """The frames of a system among what `read_mat` found, whoever wrote them.

    MATLAB's numbers are double by default: they are taken if they are the same in the type that
    `Frames` has (sensors and commands are rounded to float32).

    Raises InputError naming the first quantity that is missing, of another shape, or unfit for use.
    """
    found = {}
    for name, quantity in QUANTITIES.items():
        if name not in values:
            raise InputError(f"frames: expected {', '.join(QUANTITIES)}; {name} is missing")
        given = np.asarray(values[name])
        if given.dtype.kind not in "fiub":
            raise InputError(f"frames: {name} expects numbers, got {given.dtype}")
        if name == "images":
            given = given[:, :, None] if given.ndim == 2 else given  # MATLAB drops a last dimension of 1
            if given.ndim != 3:
                raise InputError(f"frames: images expects height × width × frames, got shape {given.shape}")
            given = np.transpose(given, (2, 0, 1))
        elif name not in row_shapes(schema, 1):
            if given.size != max(given.shape, default=0):  # neither a row nor a column
                raise InputError(f"frames: {name} expects one number a frame, got shape {given.shape}")
            given = given.reshape(-1)
        elif given.ndim != 2:
            raise InputError(f"frames: {name} expects frames × numbers, got shape {given.shape}")
        with np.errstate(invalid="ignore", over="ignore"):
            found[name] = np.ascontiguousarray(given.astype(quantity.dtype))
        if np.dtype(quantity.dtype).kind in "iu" and not np.array_equal(found[name], given):
            raise InputError(f"frames: {name} expects whole numbers of {np.dtype(quantity.dtype)}")
    counts = {name: len(values) for name, values in found.items()}
    if len(set(counts.values())) > 1:
        raise InputError(f"frames: expected as many rows of each, got {counts}")
    frames = Frames(schema, **found)
    fault = find_fault(frames, _ANY, _ANY)
    if fault:
        raise InputError(f"frames: {fault}")
    return frames


def _check(values: Mapping[str, Any]) -> None:
    for name, value in values.items():
        if not (name.isascii() and name.isidentifier() and name[0] != "_" and len(name) <= _LONGEST_NAME):
            raise InputError(f"{name!r} is no name in MATLAB; use ASCII letters, digits and _, 63 at most")
        if isinstance(value, Mapping):
            _check(value)
        elif isinstance(value, np.ndarray) and value.nbytes > LARGEST_VARIABLE:
            raise InputError(
                f"{name}: {value.nbytes / 2**30:.1f} GiB, a .mat file holds at most 2 GiB a variable; export "
                "to a folder of CSV and PNG, or read the dataset's chunks with MATLAB's h5read"
            )


def _storable(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _storable(each) for name, each in value.items()}
    if isinstance(value, list | tuple) and all(isinstance(each, str) for each in value):
        cells = np.empty((len(value), 1), dtype=object)  # a cell array of texts
        cells[:, 0] = value
        return cells
    return value


def _plain(value: Any) -> Any:
    """What SciPy made of a variable: texts as str, cells of texts as lists, structures as dictionaries."""
    if not isinstance(value, np.ndarray):
        return value
    if value.dtype.names:
        if value.size != 1:
            raise DataError(f"expected single structures, got an array of {value.size}")
        return {name: _plain(value.flat[0][name]) for name in value.dtype.names}
    if value.dtype.kind == "U":
        return str(value.flat[0]) if value.size else ""
    if value.dtype == object:
        return [_plain(each) for each in value.flat]
    return value

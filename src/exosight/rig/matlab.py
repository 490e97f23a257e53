""".mat files of versions 5 to 7.3: pictures and readings in one file.

Pictures are an array of three dimensions, or of four with colours; the order of its dimensions follows from
the number of readings. Version 7.3 is HDF5, read a block at a time; older ones are read as a whole.
"""

import hashlib
import math
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import cv2
import h5py
import numpy as np

from exosight.dataset.matlab import read_mat
from exosight.errors import DataError, InputError
from exosight.files import open_file
from exosight.hdf5 import opened, read_errors, whole_array
from exosight.rig.pictures import Gray
from exosight.rig.table import ReadingTable, TableColumn, column_of

ORDERS = ("HWN", "NHW", "HWCN", "NHWC", "NCHW")
"""Orders of dimensions as MATLAB shows them, that are told apart by shape: height, width, colours, number."""
FURTHER_ORDERS = ("WHN", "NWH", "WHCN", "NWHC", "NCWH")
"""Orders that have to be said."""

_USER_BLOCK = 512  # bytes before the HDF5 file in one of version 7.3
_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_BLOCK = 64  # pictures that are read at once
_MOST_COLUMNS = 64  # of one variable of readings
_LONGEST_TEXT = 1000


@runtime_checkable
class _Variable(Protocol):
    """An array of a .mat file, with the shape that MATLAB shows."""

    @property
    def shape(self) -> tuple[int, ...]: ...
    @property
    def dtype(self) -> np.dtype: ...
    def part(self, axis: int, start: int, stop: int) -> np.ndarray:
        """What lies between two places of an axis, with that axis first."""
        ...


class _InMemory:
    def __init__(self, values: np.ndarray) -> None:
        self._values, self.shape, self.dtype = values, values.shape, values.dtype

    def part(self, axis: int, start: int, stop: int) -> np.ndarray:
        return np.moveaxis(self._values, axis, 0)[start:stop]


class _InFile:
    """HDF5 shows the dimensions of MATLAB in reverse."""

    def __init__(self, data: h5py.Dataset, logical: bool) -> None:
        self._data, self.shape = data, data.shape[::-1]
        self.dtype = np.dtype(bool) if logical else data.dtype

    def part(self, axis: int, start: int, stop: int) -> np.ndarray:
        where = [slice(None)] * len(self.shape)
        where[len(self.shape) - 1 - axis] = slice(start, stop)
        return np.moveaxis(np.asarray(self._data[tuple(where)]).T, axis, 0)


Variables = Mapping[str, "_Variable | list[str]"]


class MatPictures:
    """The pictures of a .mat file."""

    times = None
    time_unit = None

    def __init__(self, path: Path, name: str, images: _Variable, order: str) -> None:
        self._path, self._images, self._order = path, images, order
        self._axis = order.index("N")
        count = images.shape[self._axis]
        self.names = tuple(f"{path.name}, {name} {place + 1}" for place in range(count))
        self.folders = ("",) * count
        self._start, self._block = 0, np.empty(0)
        shape = "×".join(map(str, images.shape))
        self.notes = [f"{name} of shape {shape} has its dimensions in the order {order}"]
        self._factor = self._find_factor(name)

    @property
    def fingerprint(self) -> str:
        """Of the file's size and the shape of its pictures."""
        about = f"{self._path.stat().st_size} {self._images.shape} {self._order}"
        return hashlib.sha256(about.encode()).hexdigest()

    def picture(self, place: int) -> Gray:
        """A picture; the colours of one become gray by Rec. 601."""
        if not self._start <= place < self._start + len(self._block):
            self._start = place - place % _BLOCK
            self._block = self._read(self._start)
        rest = self._order.replace("N", "")
        picture = np.transpose(
            self._block[place - self._start], [rest.index(axis) for axis in "HWC"[: len(rest)]]
        )
        if self._images.dtype == np.uint16:
            picture = (picture >> 8).astype(np.uint8)
        elif self._images.dtype != np.uint8:
            picture = np.clip(np.rint(picture * self._factor), 0, 255).astype(np.uint8)
        picture = np.ascontiguousarray(picture)
        if picture.ndim == 3:
            return picture[..., 0] if picture.shape[2] == 1 else cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
        return picture

    def _read(self, start: int) -> np.ndarray:
        try:
            return self._images.part(self._axis, start, start + _BLOCK)
        except (OSError, RuntimeError, ValueError) as error:
            raise DataError(
                f"{self.names[start]}: cannot be read ({error}); the file is truncated or damaged there"
            ) from error

    def _find_factor(self, name: str) -> float:
        """What gray values are multiplied by; InputError for a range that is neither 0…1 nor 0…255."""
        kind = self._images.dtype
        if kind == np.uint8:
            return 1.0
        lowest, highest = np.inf, -np.inf
        for start in range(0, len(self.names), _BLOCK):
            block = self._read(start)
            lowest, highest = min(lowest, block.min()), max(highest, block.max())  # NaN stays NaN
        if kind == np.uint16:
            if highest >= 4096:
                self.notes.append(f"of {name}, with 16 bits a pixel, the upper 8 were taken")
                return 1.0
            raise InputError(
                f"{self._path}: {name} has 16 bits a pixel, but no value above {highest} of 65535, which is "
                "black in 8 bits; scale it to the full range, or save it as uint8"
            )
        if kind.kind == "b" or (kind.kind == "f" and lowest >= 0 and highest <= 1):
            return 255.0
        if lowest >= 0 and highest <= 255:
            return 1.0
        raise InputError(
            f"{self._path}: {name} has gray values from {lowest:g} to {highest:g}; expected 0…1 or 0…255, so "
            "scale it"
        )


@contextmanager
def open_mat(
    path: Path, images: str | None, order: str | None, rows: int | None
) -> Iterator[tuple[MatPictures, ReadingTable]]:
    """Pictures and readings of a .mat file, which is open meanwhile.

    images  name of the variable with the pictures; by default the only one of three or four dimensions
    order   of its dimensions, one of ORDERS or FURTHER_ORDERS; by default as the number of readings says
    rows    of a table beside the file; None: the readings are variables of the file

    A variable of one number a picture is a column of its name; one of several is as many columns, whose
    headings a list of texts may give.

    Raises DataError if the file cannot be read, InputError if it does not say which variables are meant.
    """
    stack = ExitStack()
    try:
        with read_errors(path, "a .mat file"):
            variables = _variables(path, stack)
        name = images or _only_pictures(path, variables)
        found = variables.get(name)
        if found is None or isinstance(found, list) or len(found.shape) not in (3, 4):
            known = ", ".join(variables) or "none"
            raise InputError(
                f"{path}: expected pictures of three or four dimensions in the variable {name}, got {known}"
            )
        lengths = {rows} if rows is not None else _lengths(variables, name)
        chosen = _order(path, name, found.shape, order, lengths)
        count = found.shape[chosen.index("N")]
        with read_errors(path, "a .mat file"):
            table = ReadingTable(str(path), tuple(_columns(variables, name, count)))
        yield MatPictures(path, name, found, chosen), table
    finally:
        stack.close()  # not told of exceptions, which HDF5 would take for its own


def _variables(path: Path, stack: ExitStack) -> Variables:
    with open_file(path, "expected a .mat file") as content:
        head = content.read(_USER_BLOCK + len(_SIGNATURE))
    if _SIGNATURE not in (head[: len(_SIGNATURE)], head[_USER_BLOCK:]):
        found = {}
        for name, value in read_mat(path).items():
            if isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
                found[name] = _InMemory(value)
            elif isinstance(value, list) and value and all(isinstance(each, str) for each in value):
                found[name] = value
        return found
    content = stack.enter_context(open_file(path, "expected a .mat file"))
    file = stack.enter_context(opened(content, path, "a .mat file of version 7.3", _USER_BLOCK))
    return {name: variable for name in map(str, file) if (variable := _hdf5_variable(file, name)) is not None}


def _hdf5_variable(file: h5py.File, name: str) -> "_Variable | list[str] | None":
    if not isinstance(file.get(name, getlink=True), h5py.HardLink):
        return None
    data = file[name]
    if not isinstance(data, h5py.Dataset) or data.shape is None or data.external or data.is_virtual:
        return None
    if data.attrs.get("MATLAB_class") == b"cell":
        if math.prod(data.shape) > _MOST_COLUMNS:
            return None
        texts = [_text(file, reference) for reference in np.asarray(data[()]).ravel(order="F")]
        return [text for text in texts if text is not None] if None not in texts else None
    if data.dtype.kind not in "fiub" or data.attrs.get("MATLAB_class") == b"char":
        return None
    logical = data.attrs.get("MATLAB_class") == b"logical"  # stored as bytes
    return _InFile(whole_array(file, name, data.dtype, (None,) * data.ndim), logical)


def _text(file: h5py.File, reference: Any) -> str | None:
    """What a cell holds, if it is a text."""
    data = file[reference] if isinstance(reference, h5py.Reference) else None
    if not isinstance(data, h5py.Dataset) or data.dtype != np.uint16 or data.external or data.is_virtual:
        return None
    if math.prod(data.shape or (0,)) > _LONGEST_TEXT:
        return None
    return "".join(map(chr, np.asarray(data[()]).ravel().tolist()))


def _only_pictures(path: Path, variables: Variables) -> str:
    found = [name for name, v in variables.items() if not isinstance(v, list) and len(v.shape) in (3, 4)]
    if len(found) == 1:
        return found[0]
    got = ", ".join(found) if found else f"none among {', '.join(variables) or 'none'}"
    raise InputError(
        f"{path}: expected one variable of three or four dimensions, the pictures, got {got}; name it with "
        "--images"
    )


def _lengths(variables: Variables, images: str) -> set[int]:
    """Numbers of readings that the variables may be of."""
    return {
        side
        for name, variable in variables.items()
        if name != images and not isinstance(variable, list) and len(variable.shape) == 2
        for side in variable.shape
        if side > 1
    }


def _order(path: Path, name: str, shape: tuple[int, ...], order: str | None, lengths: set[int]) -> str:
    """The order of dimensions, as it is said or as the number of readings says."""
    if order is not None:
        if order not in (*ORDERS, *FURTHER_ORDERS) or len(order) != len(shape):
            fitting = [each for each in (*ORDERS, *FURTHER_ORDERS) if len(each) == len(shape)]
            raise InputError(
                f"order: expected one of {', '.join(fitting)} for {len(shape)} dimensions, got {order}"
            )
        return order
    found = [each for each in ORDERS if len(each) == len(shape) and _fits(each, shape, lengths)]
    if len(found) == 1:
        return found[0]
    sides = "×".join(map(str, shape))
    if found:
        raise InputError(
            f"{path}: {name} of shape {sides} may have its dimensions in the order {' or '.join(found)}; say "
            "which with --order"
        )
    counts = ", ".join(map(str, sorted(lengths))) or "none"
    raise InputError(
        f"{path}: none of the dimensions of {name}, {sides}, is the number of readings ({counts}); expected "
        "a reading a picture, or say the order of dimensions with --order"
    )


def _fits(order: str, shape: tuple[int, ...], lengths: set[int]) -> bool:
    sides = dict(zip(order, shape, strict=True))
    return sides["N"] in lengths and sides.get("C", 1) in (1, 3)


def _columns(variables: Variables, images: str, count: int) -> list[TableColumn]:
    """The variables with a number or a text a picture."""
    texts = [each for each in variables.values() if isinstance(each, list)]
    found: list[TableColumn] = []
    for name, variable in variables.items():
        if isinstance(variable, list):
            if len(variable) == count:
                found.append(column_of(name, variable))
            continue
        if name == images or len(variable.shape) != 2 or count not in variable.shape:
            continue
        axis = variable.shape.index(count)
        width = variable.shape[1 - axis]
        if width > _MOST_COLUMNS:
            continue
        values = variable.part(axis, 0, count).astype(float)
        heads = [name] if width == 1 else next((t for t in texts if len(t) == width), None)
        heads = heads or [f"{name}_{place + 1}" for place in range(width)]
        found += [
            column_of(head, map(repr, column.tolist())) for head, column in zip(heads, values.T, strict=True)
        ]
    return found

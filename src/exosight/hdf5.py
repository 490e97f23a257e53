"""HDF5 files of unknown origin: what is read lies in the file itself, and is no larger than what it stores.

A link may lead to another file, or to a pipe that never answers, and so may an array that is virtual or kept
elsewhere; a shape is a promise that costs its writer nothing. All of it is checked before anything is read.
"""

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedIOBase, BufferedReader
from typing import Any

import h5py
import numpy as np

from exosight.errors import DataError, ExosightError

LARGEST_BLOCK = 2**28
"""Largest part of an array that is unpacked at once [bytes]."""

LARGEST_HEAPS = 2**22
"""Largest sum of what the texts of a file take [bytes]."""

_SIGNATURE = b"\x89HDF\r\n\x1a\n\x03"
_SUPERBLOCK = 44  # bytes, before its checksum
_MARK, _SIZE = 11, slice(28, 36)  # where it says that the file is open, and how long it is

_HEAP = b"GCOL\1"
"""What a heap of texts begins with."""

_BLOCK = 2**24
"""Bytes that are searched for heaps at a time."""

_DEFLATE = 1032
"""At most this many times smaller an array gets by Deflate."""


@contextmanager
def opened(content: BufferedIOBase, name: object, what: str, user_block: int = 0) -> Iterator[h5py.File]:
    """An HDF5 file for reading; whatever is wrong with it meanwhile ends as DataError.

    name         of the file, for messages
    what         it is expected to be
    user_block   bytes of something else that it may begin with
    """
    with read_errors(name, what):
        _check_heaps(content, user_block)
        with h5py.File(content, "r") as file:
            yield file


@contextmanager
def read_errors(name: object, what: str) -> Iterator[None]:
    """Whatever h5py raises for a damaged file, as DataError; arguments as of `opened`."""
    try:
        yield
    except ExosightError:
        raise
    # HDF5 and h5py raise these for damaged files; a shape may also be more than memory can hold.
    except (
        OSError,
        LookupError,
        RuntimeError,
        ValueError,
        TypeError,
        AttributeError,
        ArithmeticError,
    ) as error:
        raise DataError(f"{name}: damaged, or not {what} ({error})") from error


def _check_heaps(content: BufferedIOBase, user_block: int) -> None:
    """ValueError for a heap of texts that HDF5 would read without end: each says where the next begins.

    Source: HDF5 File Format Specification 3.0, "Global Heap" and "Superblock".
    """
    content.seek(0)
    head = content.read(user_block + 15)
    head = head if head[:8] == _SIGNATURE[:8] else head[user_block:]
    if head[:8] != _SIGNATURE[:8] or (head[9:11] if head[8] >= 2 else head[13:15]) != b"\x08\x08":
        raise ValueError("no HDF5 file with addresses and lengths of 8 bytes from its first byte on")
    size, at, left = content.seek(0, os.SEEK_END), 0, LARGEST_HEAPS
    while at < size:
        content.seek(at)
        block = content.read(_BLOCK + len(_HEAP) - 1)
        found = block.find(_HEAP)
        while found >= 0:
            content.seek(at + found + 8)
            length = int.from_bytes(content.read(8), "little")
            if length <= size - at - found:  # HDF5 refuses what the file has no room for
                left -= length
                if left < 0:
                    raise ValueError(f"heaps of texts of more than {LARGEST_HEAPS} bytes")
                _check_heap(content.read(max(0, length - 16)))
            found = block.find(_HEAP, found + 1)
        at += _BLOCK
    content.seek(0)


def _check_heap(objects: bytes) -> None:
    at = 0
    while at + 16 <= len(objects):
        length = int.from_bytes(objects[at + 8 : at + 16], "little")
        if any(objects[at : at + 2]):  # an object, and not the space that is left
            length += 16 + -length % 8
        if not 0 < length < 2**63:
            raise ValueError("a heap of texts without an end")
        at += length


class _Closed(BufferedReader):
    """A file whose first bytes are others."""

    head = b""

    def readinto(self, buffer: Any) -> int:
        start, count = self.tell(), super().readinto(buffer)
        changed = self.head[start : start + count]
        memoryview(buffer).cast("B")[: len(changed)] = changed
        return count


def as_closed(content: BufferedReader) -> BufferedReader:
    """A file that is taken over, with a head as of a closed one, if its writer was killed.

    HDF5's own way to open such a file (SWMR) waits without end where it is damaged as well.
    Source: HDF5 File Format Specification 3.0, superblock version 3.
    """
    found = _Closed(content.detach())
    head = bytearray(found.read(_SUPERBLOCK))
    if head[:9] == _SIGNATURE and len(head) == _SUPERBLOCK and head[_MARK]:
        head[_MARK] = 0
        head[_SIZE] = found.seek(0, os.SEEK_END).to_bytes(8, "little")  # which only closing updates
        found.head = bytes(head) + _lookup3(bytes(head)).to_bytes(4, "little")
    return found


def _lookup3(data: bytes) -> int:
    """Checksum of metadata in HDF5: hashlittle of Bob Jenkins's lookup3, of 13 bytes or more."""

    def rotated(x: int, bits: int) -> int:
        return (x << bits | x >> (32 - bits)) & 0xFFFFFFFF

    a = b = c = 0xDEADBEEF + len(data)
    for start in range(0, len(data), 12):
        block = data[start : start + 12].ljust(12, b"\0")
        a, b, c = (
            (x + int.from_bytes(block[i : i + 4], "little")) & 0xFFFFFFFF
            for x, i in zip((a, b, c), (0, 4, 8), strict=True)
        )
        if start + 12 < len(data):
            for bits in (4, 6, 8, 16, 19, 4):
                a, b, c = b, (c + b) & 0xFFFFFFFF, ((a - c) & 0xFFFFFFFF) ^ rotated(c, bits)
    for bits in (14, 11, 25, 16, 4, 14, 24):
        a, b, c = b, ((c ^ b) - rotated(b, bits)) & 0xFFFFFFFF, a
    return b


def group(file: h5py.Group, name: str) -> h5py.Group:
    """A group that lies in the file itself; ValueError if there is none."""
    found = _member(file, name)
    if not isinstance(found, h5py.Group):
        raise ValueError(f"{name} is not a group of this file")
    return found


def array(
    file: h5py.Group, name: str, kind: np.dtype | type | str, shape: tuple[int | None, ...]
) -> h5py.Dataset:
    """An array that lies in the file itself; how much of it is stored there `stored_rows` says.

    kind    of its numbers
    shape   as expected; None: of any length

    Raises ValueError if it is missing, of another kind or shape, or packed in a way that is not read.
    """
    data = _member(file, name)
    if not isinstance(data, h5py.Dataset) or data.external or data.is_virtual:
        raise ValueError(f"{name} is not an array of this file")
    found = data.shape
    same = found is not None and len(found) == len(shape) and not any(map(_differs, shape, found))
    if data.dtype != np.dtype(kind) or not same:
        wanted = str(shape).replace("None", "any")
        raise ValueError(f"{name} expects {np.dtype(kind)} {wanted}, got {data.dtype} {found}")
    if _filters(data) not in ([], [h5py.h5z.FILTER_DEFLATE]):
        raise ValueError(f"{name} is packed by something else than Deflate")
    if data.chunks and (size := math.prod(data.chunks) * data.dtype.itemsize) > LARGEST_BLOCK:
        raise ValueError(f"{name} is stored in blocks of {size} bytes, at most {LARGEST_BLOCK} are read")
    return data


def whole_array(
    file: h5py.Group, name: str, kind: np.dtype | type | str, shape: tuple[int | None, ...]
) -> h5py.Dataset:
    """An array as `array` gives it; ValueError also if the file stores only a part of it."""
    data = array(file, name, kind, shape)
    if (stored := stored_rows(data)) < (claimed := data.shape[0] if shape else 1):
        raise ValueError(f"{name} claims {claimed} rows, the file stores {stored}")
    return data


def stored_rows(data: h5py.Dataset) -> int:
    """The rows of an array that its file has room for; one number is one row, rows of none need no room."""
    rows, *row = data.shape or (1,)
    if 0 in row:
        return rows
    bytes_stored = min(data.id.get_storage_size(), data.file.id.get_filesize())
    unpacked = bytes_stored * (_DEFLATE if _filters(data) else 1)
    rows = min(rows, unpacked // max(1, math.prod(row) * data.dtype.itemsize))
    if data.chunks:
        high, *block = data.chunks
        blocks_a_row = math.prod(-(-side // length) for side, length in zip(row, block, strict=True))
        rows = min(rows, data.id.get_num_chunks() // max(1, blocks_a_row) * high)
    return rows


def text(file: h5py.Group, name: str) -> str:
    """One text among the attributes; ValueError if it is missing or something else."""
    if name not in file.attrs or file.attrs.get_id(name).shape != ():
        raise ValueError(f"it has no text {name}")
    value = file.attrs[name]
    if not isinstance(value, str):
        raise ValueError(f"{name} is no text")
    return value


def _member(file: h5py.Group, name: str) -> h5py.Group | h5py.Dataset | h5py.Datatype:
    *outside, last = name.split("/")
    for step in outside:
        file = group(file, step)
    if not isinstance(file.get(last, getlink=True), h5py.HardLink):
        raise ValueError(f"{name} is missing, or a link; expected it in this file")
    return file[last]


def _differs(wanted: int | None, found: int) -> bool:
    return wanted not in (None, found)


def _filters(data: h5py.Dataset) -> list[int]:
    packing = data.id.get_create_plist()
    return [packing.get_filter(i)[0] for i in range(packing.get_nfilters())]

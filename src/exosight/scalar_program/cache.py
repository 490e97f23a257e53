"""Programs and the interpreter, kept on disk where JAX keeps what it compiles (`JAX_COMPILATION_CACHE_DIR`).

A program is found again by its jaxpr: by what is computed, not by the names of what computes it. So a term
that a user changes gets another program. Files are as safe as those of JAX beside them: whoever can write
there can have any code run.
"""

import hashlib
import io
from collections.abc import Callable, Sequence
from contextlib import suppress
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Any, no_type_check

import jax
import numpy as np
from jax.extend.core import ClosedJaxpr, Jaxpr, Literal

from exosight.errors import DataError
from exosight.files import read_file, replace_file
from exosight.scalar_program.program import Program

FOLDER = "exosight_programs"
"""Within JAX's folder."""

LARGEST = 256 * 2**20
"""[bytes] of a file that is read; the programs of `index` take 2 MiB."""


def kept_programs(
    jaxpr: ClosedJaxpr, stages: Sequence[tuple[int, int]], make: Callable[[], Sequence[Program]]
) -> list[Program]:
    """The programs of a jaxpr: those that are kept, else made, and kept from now on.

    stages   numbers of arguments and of results of each
    """
    if not _folder():
        return list(make())
    made: list[Program] = []

    def encoded() -> bytes:
        made.extend(make())
        return _encoded(made)

    content = kept_bytes(f"{fingerprint(jaxpr, stages)}.npz", encoded)
    return made or _decoded(content)


def _folder() -> str | None:
    """That of JAX; None where it keeps nothing."""
    return jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue] - made at run time


def kept_bytes(name: str, make: Callable[[], bytes]) -> bytes:
    """The content of a file of this name, made if there is none, or if it is damaged.

    It ends in the SHA-256 of what is before.
    """
    folder = _folder()
    if not folder:
        return make()
    file = Path(folder) / FOLDER / name
    with suppress(DataError):
        content = read_file(file, LARGEST, "a program")
        if hashlib.sha256(content[:-32]).digest() == content[-32:]:
            return content[:-32]
    content = make()
    with suppress(DataError, OSError):  # a full disk, or a folder that is not to be written
        file.parent.mkdir(parents=True, exist_ok=True)
        replace_file(file, content + hashlib.sha256(content).digest())
    return content


def _encoded(programs: Sequence[Program]) -> bytes:
    arrays = {
        f"{name}{i}": value for i, program in enumerate(programs) for name, value in program._asdict().items()
    }
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def _decoded(content: bytes) -> list[Program]:
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        count = len(arrays.files) // len(Program._fields)
        rows = [[arrays[f"{name}{i}"] for name in Program._fields] for i in range(count)]
    return [Program(*numbers, slots=int(slots)) for *numbers, slots in rows]


def source_hash(of: bytes = b"") -> str:
    """Of the code that makes programs and the interpreter, NumPy, which folds constants, and `of`."""
    return hashlib.sha256(_sources() + of).hexdigest()


@cache
def _sources() -> bytes:
    content = hashlib.sha256(np.__version__.encode())
    for file in sorted(Path(__file__).parent.glob("*.py")):
        content.update(file.read_bytes())
    return content.digest()


def fingerprint(jaxpr: ClosedJaxpr, stages: Sequence[tuple[int, int]]) -> str:
    """The same for what gives the same programs: equations, constants and stages."""
    content = hashlib.sha256(source_hash().encode())
    content.update(str(tuple(stages)).encode())
    _add(content.update, jaxpr)
    return content.hexdigest()


def _add(update: Callable[[bytes], None], closed: ClosedJaxpr) -> None:
    for const in closed.consts:
        _add_array(update, const)
    _add_equations(update, closed.jaxpr)


def _add_array(update: Callable[[bytes], None], value: Any) -> None:
    array = np.asarray(value)
    update(f"{array.dtype}{array.shape}".encode() + array.tobytes())


@no_type_check  # see conditional
def _add_equations(update: Callable[[bytes], None], jaxpr: Jaxpr) -> None:
    names: dict[Any, int] = {}

    def write(variables: Sequence[Any]) -> None:
        words = []
        for variable in variables:
            if isinstance(variable, Literal):
                words.append("literal")
                _add_array(update, variable.val)
            elif variable in names:
                words.append(str(names[variable]))
            else:
                names[variable] = len(names)
                words.append(f"{names[variable]}{variable.aval.str_short()}")
        update(";".join(words).encode())

    write([*jaxpr.constvars, *jaxpr.invars])
    for equation in jaxpr.eqns:
        update(equation.primitive.name.encode())
        for name in sorted(equation.params):
            update(name.encode())
            _add_parameter(update, equation.params[name])
        write(equation.invars)
        write(equation.outvars)
    write(jaxpr.outvars)


_TOLD = Enum, np.dtype, np.generic, bool, int, float, str
"""Kinds of parameters of which all is told."""


@no_type_check  # see conditional
def _add_parameter(update: Callable[[bytes], None], value: Any) -> None:
    """All that the rules of `tracing` look at; of anything else (functions, devices) only the kind."""
    if isinstance(value, ClosedJaxpr):
        _add(update, value)
    elif isinstance(value, Jaxpr):
        _add_equations(update, value)
    elif isinstance(value, tuple | list):
        update(f"({len(value)}".encode())
        for part in value:
            _add_parameter(update, part)
    elif value is None or isinstance(value, _TOLD):
        update(repr(value).encode())
    else:
        update(type(value).__name__.encode())

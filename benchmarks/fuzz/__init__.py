"""Mutated inputs for everything that takes files, words or requests of unknown origin.

Each entry is a class that is made with an empty folder and called with a random generator: it makes one input
and hands it over. What refuses its input raises InputError or DataError; any other exception is a defect. A
call is reproduced by its number alone, see `draw_of`.
"""

import random
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from copy import deepcopy
from importlib import import_module
from pathlib import Path

from exosight.errors import DataError, InputError

sys.path.append(str(Path(__file__).parents[2] / "tests" / "support"))  # systems and networks made for tests

DOORS = {
    "system": ("system", 2),
    "recording": ("arrays", 1),
    "dataset": ("arrays", 1),
    "picture": ("pictures", 70),
    "model": ("models", 3),
    "command": ("commands", 5),
    "page": ("page", 18),
}
"""Module of each, and its share of the inputs [%]: what is quick gets more."""

Attempt = Callable[[random.Random], None]


def opened(name: str, folder: Path) -> Attempt:
    """What takes one input of a kind, with an empty folder of its own."""
    return getattr(import_module(f"benchmarks.fuzz.{DOORS[name][0]}"), name.capitalize())(folder)


def draw_of(name: str, seed: int, number: int) -> random.Random:
    """The generator of one input."""
    return random.Random(f"{name} {seed} {number}")


def outcome(attempt: Attempt, draw: random.Random) -> str:
    """What becomes of one input, "accepted" or "refused"; AssertionError for a sentence that is none."""
    try:
        attempt(draw)
    except (InputError, DataError) as error:
        sentence = str(error)
        assert sentence.isprintable(), repr(sentence)
        assert 0 < len(sentence) < 2000, sentence
        return "refused"
    return "accepted"


def outcomes(name: str, count: int, seed: int, folder: Path) -> Counter[str]:
    """Outcomes of so many inputs of a kind; whatever one raises beside a refusal is raised here."""
    attempt = opened(name, folder)
    return Counter(outcome(attempt, draw_of(name, seed, number)) for number in range(count))


def some_bytes(content: bytes, draw: random.Random) -> bytes:
    """The content after a few bytes were changed, removed, doubled or cut off."""
    found = bytearray(content)
    for _ in range(draw.choice((1, 1, 2, 4, 16))):
        if not found:
            break
        at = draw.randrange(len(found))
        length = draw.choice((1, 2, 4, 8, 64))
        match draw.randrange(8):
            case 0:
                del found[at : at + length]
            case 1:
                found[at:at] = found[at : at + length]
            case 2:
                found[at : at + 4] = draw.choice(
                    (b"\0\0\0\0", b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"\0\0\0\x80")
                )
            case 3 if draw.random() < 0.3:
                del found[at:]
            case _:
                found[at] = draw.randrange(256)
    return bytes(found)


_LEAVES = (
    *(
        None,
        True,
        float("nan"),
        float("inf"),
        -1,
        0,
        1,
        0.5,
        999,
        1e30,
        1e308,
        -1e308,
        5e-324,
        2**31,
        2**63,
        2**70,
    ),
    *("", "x" * 3000, "\x1b[31m", "\x00", "/dev/zero", "../..", [], {}, [[]], [0] * 3000, {"a": [{}]}),
)
"""What takes the place of a value in JSON."""


def some_values(value: object, draw: random.Random) -> object:
    """Nested lists and dictionaries of which one to three values were changed, in place."""
    for _ in range(draw.choice((1, 1, 2, 3))):
        _one_value(value, draw)
    return value


def _one_value(value: object, draw: random.Random) -> None:
    while True:
        keys = list(value) if isinstance(value, dict) else list(range(len(value)))
        if not keys:
            return
        key = draw.choice(keys)
        inner = value[key]
        if not (isinstance(inner, dict | list) and inner) or draw.random() < 0.15:
            break
        value = inner
    match draw.randrange(6):
        case 0:
            del value[key]
        case 1 if isinstance(value, list):
            value.insert(key, deepcopy(inner))
        case 2 if isinstance(value, dict):
            value[draw.choice(("extra", "\x1b", *keys))] = deepcopy(inner)
        case 3 if isinstance(inner, int | float) and not isinstance(inner, bool):
            value[key] = inner * draw.choice((-1, 0.5, 1.01, 2, 10, 1e6))
        case _:
            value[key] = deepcopy(draw.choice(_LEAVES))


def every(
    attempt: Attempt, name: str, seed: int, start: int, count: int
) -> Iterator[tuple[int, str, Exception | None]]:
    """Number, outcome and, for a defect, the exception of one input after the other."""
    for number in range(start, start + count):
        try:
            yield number, outcome(attempt, draw_of(name, seed, number)), None
        except Exception as error:
            yield number, "defect", error

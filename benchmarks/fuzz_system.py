"""Mutations of valid system files: `python -m benchmarks.fuzz_system [COUNT [SEED]]`, 10,000 by default.

Every mutation has to be refused in one sentence, or to give a system, and both within seconds. Counts are
printed; a traceback or a hang ends the program with the mutation that did it.
"""

import random
import re
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from exosight.errors import DataError, InputError
from exosight.system.designs import FileDesigns
from exosight.system.file import read_system_file

FILES = sorted((Path(__file__).parents[1] / "examples" / "systems").iterdir())
LONGEST = 5
"""Time for one mutation [s]."""

TOKEN = re.compile(r'"[^"\n]*"|[A-Za-z_][\w.]*|-?\d+\.?\d*|[\[\]{}=,]')
VALUES = (
    *(
        "nan",
        "-inf",
        "1e400",
        "-1",
        "0",
        "1e9",
        "9" * 400,
        "9" * 5000,
        "true",
        "1979-05-27",
        "[]",
        "{}",
        '""',
    ),
    *(
        '"45 mm"',
        '"45"',
        '"1e300 m"',
        '"-3 mm"',
        '"12 bananas"',
        '"nan mm"',
        '"0 N"',
        '"300 kPa"',
        '"5 N/kPa"',
    ),
    *(
        '"sleeve"',
        '"arm"',
        '"P1"',
        '"\\u001b[31m"',
        '"../../etc/passwd"',
        '"profile.csv"',
        '"/dev/zero"',
        "2000",
    ),
    *(
        '"X**0.5"',
        '"9**9**9**9"',
        '"1/(X-0.5)"',
        '"().__class__"',
        '"1if X else 2"',
        f'"{"(" * 90}X{")" * 90}"',
    ),
    *("[" * 500, "[[[[1]]]]", f"{{{'a.' * 300}a = 1}}", f"[{', '.join(['0.5'] * 3000)}]", "[[], {}]"),
)
"""What takes the place of a value: other kinds, units and sizes, and what parsers stumble over."""


def mutate(text: str, draw: random.Random) -> bytes:
    """The text after one to four changes of bytes, tokens, values, lines or tables."""
    for _ in range(draw.choice((1, 1, 1, 2, 4))):
        text = draw.choice((_bytes, _tokens, _value, _value, _value, _lines, _tables))(text, draw)
    return text.encode("utf-8", "surrogateescape")


def _bytes(text: str, draw: random.Random) -> str:
    content = bytearray(text.encode("utf-8", "surrogateescape"))
    for _ in range(draw.randint(1, 4)):
        if content:
            content[draw.randrange(len(content))] = draw.randrange(256)
    return content.decode("utf-8", "surrogateescape")


def _tokens(text: str, draw: random.Random) -> str:
    found = list(TOKEN.finditer(text))
    if len(found) < 2:
        return text
    first, second = sorted(draw.sample(found, 2), key=re.Match.start)
    between = text[first.end() : second.start()]
    return text[: first.start()] + second[0] + between + first[0] + text[second.end() :]


def _value(text: str, draw: random.Random) -> str:
    found = [each for each in TOKEN.finditer(text) if each[0][0] in '"-0123456789']
    if not found:
        return text
    one = draw.choice(found)
    new = draw.choice(VALUES) if draw.random() < 0.7 else draw.choice(found)[0]
    return text[: one.start()] + new + text[one.end() :]


def _lines(text: str, draw: random.Random) -> str:
    lines = text.split("\n")
    at = draw.randrange(len(lines))
    change = draw.randrange(4)
    if change == 0:
        del lines[at]
    elif change == 1:
        lines.insert(draw.randrange(len(lines)), lines[at])
    elif change == 2:
        lines[at] = lines[at].split("=")[0] + "= " + draw.choice(VALUES)
    else:
        lines.insert(at, f"{draw.choice(('extra', 'length', 'parent', 'csv'))} = {draw.choice(VALUES)}")
    return "\n".join(lines)


def _tables(text: str, draw: random.Random) -> str:
    tables = re.split(r"\n(?=\[)", text)
    one = draw.randrange(len(tables))
    change = draw.randrange(4)
    if change == 0:
        del tables[one]
    elif change == 1:
        tables.insert(draw.randrange(len(tables) + 1), tables[one])
    elif change == 2:  # renamed, many times over
        tables += [tables[one].replace("]", f"_{i}]", 1) for i in range(draw.choice((1, 2, 100, 300)))]
    else:
        other = draw.randrange(len(tables))
        tables[one], tables[other] = tables[other], tables[one]
    return "\n".join(tables)


def outcome(path: Path) -> str:
    """What becomes of a file: "system", or the kind of its refusal; AssertionError for a bad sentence."""
    try:
        FileDesigns(read_system_file(path))
    except (InputError, DataError) as error:
        sentence = str(error)
        assert sentence.isprintable(), repr(sentence)
        assert len(sentence) < 2000, sentence
        return "not read" if isinstance(error, DataError) else "refused"
    return "system"


def fuzz(count: int, seed: int, folder: Path) -> tuple[Counter[str], float]:
    """Outcomes of so many mutations, and the longest time that one took [s]; TimeoutError for a hang."""
    for file in FILES:
        shutil.copy(file, folder)
    texts = [file.read_text(encoding="utf-8") for file in FILES if file.suffix == ".toml"]
    draw, found, longest = random.Random(seed), Counter[str](), 0.0
    path = folder / "mutation.toml"

    def hang(*_: object) -> None:
        raise TimeoutError(f"more than {LONGEST} s: {path.read_bytes()!r}")

    before = signal.signal(signal.SIGALRM, hang)
    try:
        for _ in range(count):
            path.write_bytes(mutate(draw.choice(texts), draw))
            begun = time.perf_counter()
            signal.alarm(LONGEST)
            found[outcome(path)] += 1
            signal.alarm(0)
            longest = max(longest, time.perf_counter() - begun)
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
    return found, longest


def main() -> None:
    """Mutate, count, print."""
    count, seed = (int(word) for word in [*sys.argv[1:], *("10000", "0")[len(sys.argv) - 1 :]])
    with tempfile.TemporaryDirectory() as folder:
        found, longest = fuzz(count, seed, Path(folder))
    print(f"{count} mutations: {dict(found)}; the slowest took {longest:.2f} s")


if __name__ == "__main__":
    main()

"""System files: bytes, tokens, values, lines and tables of the examples changed."""

import random
import re
import shutil
from pathlib import Path

from exosight.system.designs import FileDesigns
from exosight.system.file import read_system_file

FILES = sorted((Path(__file__).parents[2] / "examples" / "systems").iterdir())

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


class System:
    """System files: read, and all designs built."""

    def __init__(self, folder: Path) -> None:
        for file in FILES:
            shutil.copy(file, folder)
        self._texts = [file.read_text(encoding="utf-8") for file in FILES if file.suffix == ".toml"]
        self._path = folder / "mutation.toml"

    def __call__(self, draw: random.Random) -> None:
        """One file."""
        self._path.write_bytes(mutate(draw.choice(self._texts), draw))
        FileDesigns(read_system_file(self._path))

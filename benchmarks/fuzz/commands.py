"""Command lines: commands and options of every help text, with values of all kinds."""

import io
import os
import random
import re
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

from exosight.app import options
from exosight.app.main import COMMANDS, main
from exosight.errors import InputError

_VALUES = (
    *(
        "",
        "-",
        "--",
        "-1",
        "0",
        "1",
        "2.4",
        "nan",
        "inf",
        "-inf",
        "1e400",
        "9" * 400,
        "0x10",
        "1_0",
        "1,5",
        "٣",
    ),
    *(
        "true",
        "None",
        "none",
        "all",
        "shipped",
        "published",
        "auto",
        "[1, 2]",
        "{}",
        "a=b",
        "young=300 kPa",
        "=",
        "a=",
    ),
    *("\x1b[31m", "\x00", "\n", "x" * 5000, "é…π", "\udcff", "%s", "{}", "[red]", "$HOME", "*", "../..", "."),
    *("none.toml", "run.h5", "picture.png", "model.onnx", "folder", "two words"),
)


class Command:
    """Command lines: read by the program itself; of the commands only `system` also works on them."""

    def __init__(self, folder: Path) -> None:
        os.chdir(folder)  # where `system new` writes
        os.environ["EXOSIGHT_TRACEBACK"] = "1"
        self._options = {name: _options(name) for name in COMMANDS}
        read = options.read_options

        def checked(command: Callable[..., None], words: Sequence[str]) -> Callable[[], None] | None:
            chosen = read(command, words)
            return chosen if chosen is None or command.__name__ == "system" else lambda: None

        options.read_options = checked

    def __call__(self, draw: random.Random) -> None:
        """One command line."""
        code, _, complaint = _run(self._words(draw))
        if code not in (0, 2):
            raise AssertionError(f"exit code {code}")
        if code == 2:
            assert complaint.startswith("exosight: "), complaint
            raise InputError(
                complaint[:-1] if complaint[:-1].isprintable() else f"not printable: {complaint!r}" * 99
            )

    def _words(self, draw: random.Random) -> list[str]:
        name = draw.choice(list(COMMANDS))
        words = [name]
        for _ in range(draw.choice((0, 1, 1, 2, 3, 8))):
            match draw.randrange(5):
                case 0:
                    words.append(draw.choice(_VALUES))
                case 1:
                    words.append(draw.choice(self._options[draw.choice(list(COMMANDS))]))
                case 2:
                    words += [
                        draw.choice(self._options[name]),
                        *draw.choices(_VALUES, k=draw.choice((0, 2, 3, 20))),
                    ]
                case 3:
                    words.append(f"{draw.choice(self._options[name])}={draw.choice(_VALUES)}")
                case _:
                    words += [draw.choice(self._options[name]), draw.choice(_VALUES)]
        if draw.random() < 0.1:
            at = draw.randrange(len(words))
            letters = list(words[at][:50])
            draw.shuffle(letters)
            words[at] = "".join(letters)
        return words


def _run(words: list[str]) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of the program."""
    shown, complaint = io.StringIO(), io.StringIO()
    with redirect_stdout(shown), redirect_stderr(complaint):
        try:
            main(words)
        except SystemExit as end:
            return end.code or 0, shown.getvalue(), complaint.getvalue()
    return 0, shown.getvalue(), complaint.getvalue()


def _options(name: str) -> list[str]:
    return sorted(set(re.findall(r"(?<![\w-])--?[a-z][a-z-]*", _run([name, "--help"])[1]))) or ["--help"]

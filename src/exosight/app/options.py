"""From the words of a command line to a command's arguments, by way of Tyro."""

import inspect
import io
import re
import shutil
import sys
import textwrap
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from functools import partial, wraps
from itertools import takewhile
from typing import Any

import pydantic
import tyro

from exosight.errors import InputError

_DESCRIPTION = "DESCRIPTION"


def read_options(command: Callable[..., None], options: Sequence[str]) -> Callable[[], None] | None:
    """The command bound to the options given, ready to be called; None if help was asked for and printed.

    Raises InputError with one sentence for whatever is wrong with the options.
    """
    prog = f"exosight {command.__name__.rstrip('_')}"
    if {"-h", "--help"} & set(options):
        options = ["--help"]  # what stands before it would be left out of the usage
    shown, complaint = _Held(sys.stdout), _Held(sys.stderr)
    try:
        with redirect_stdout(shown), redirect_stderr(complaint):
            return tyro.cli(
                pydantic.validate_call(_binding(command)),
                prog=prog,
                description=_DESCRIPTION,
                args=options,
                config=(tyro.conf.DisallowNone,),
            )
    except SystemExit as end:
        if end.code:
            raise InputError(f"{_sentence(complaint.getvalue())}; see {prog} --help") from None
        usage, rest = shown.getvalue().split("\n", 1)
        print(textwrap.fill(usage, _width(), subsequent_indent="  "))
        print(rest.replace(_DESCRIPTION, _description(command), 1), end="")
        return None
    except pydantic.ValidationError as error:
        fault = error.errors()[0]
        name = "-".join(str(part) for part in fault["loc"]).replace("_", "-")
        words = fault["msg"][0].lower() + fault["msg"][1:]
        raise InputError(f"--{name}: {words}, got {str(fault['input'])[:80]}; see {prog} --help") from None


class _Held(io.StringIO):
    """Text held back; Tyro draws boxes where it reads "utf-8", and colours them on a terminal."""

    encoding = "utf-8"

    def __init__(self, stream: Any) -> None:  # any text stream: a test's is not a TextIO by its type
        super().__init__()
        self.isatty = stream.isatty


def _binding(command: Callable[..., None]) -> Callable[..., Callable[[], None]]:
    """What has the command's options but does nothing yet: reading options and working fail differently."""

    @wraps(command)
    def bind(*args: Any, **kwargs: Any) -> Callable[[], None]:
        return partial(command, *args, **kwargs)

    return bind


def _description(command: Callable[..., None]) -> str:
    """The docstring down to its arguments, broken into lines, which Tyro does not do."""
    paragraphs = (inspect.getdoc(command) or "").partition("\n\nArgs:")[0].split("\n\n")
    # Indented lines are examples, to be copied as they are.
    filled = [
        text if "\n  " in text else textwrap.fill(" ".join(text.split()), _width()) for text in paragraphs
    ]
    return "\n\n".join(filled)


def _width() -> int:
    return min(shutil.get_terminal_size().columns, 100)


def _sentence(box: str) -> str:
    """What a box drawn by Tyro complains about, as one line in plainer words."""
    lines = [line.strip("│")[1:].rstrip() for line in box.splitlines()[1:-1]]
    first = list(takewhile(lambda line: line.strip("─"), lines))  # up to a blank line or a rule
    missing = [line.strip() for line in first if line.startswith("    --")]
    text = " ".join(line.strip() for line in first).rstrip(".")
    if missing:
        text = f"expected {' and '.join(missing)}, got none"
    for pattern, plainer in _PLAINER:
        text = re.sub(pattern, plainer, text)
    if "Perhaps you meant:" in lines:
        text += f"; perhaps you meant {lines[lines.index('Perhaps you meant:') + 1].strip()}"
    return text[:1].lower() + text[1:]


_PLAINER = (
    (r"^Missing from exosight \S+: (\S+) .*", r"expected \1, got none"),
    (r"^Error parsing (config\.)?", ""),
    (r"^Unrecognized options:", "unknown options:"),
    (r"^Missing value for argument '(.*)'\. Expected 1 values", r"\1: expected a value, got none"),
    (
        r"^invalid choice (.*) for argument '(.*)'\. Expected one of \((.*)\)",
        r"\2: expected one of \3, got \1",
    ),
    (r", 'None'|'None', ", ""),
    (r"invalid literal for int\(\) with base 10:", "expected a whole number, got"),
    (r"could not convert string to float:", "expected a number, got"),
    (r"Could not find valid parse for arguments: \[(.*)\]", r"expected numbers, got \1"),
    (
        r"no type matching \{?\[FLOAT \[FLOAT \.\.\.\]\]\}? could be instantiated from \[(.*)\]",
        r"expected numbers, got \1",
    ),
    (r"no type matching \{(.*?)\} could be instantiated from \[(.*)\]", r"expected \1, got \2"),
    (r"no type matching (\S+) could be instantiated from \[(.*)\]", r"expected \1, got \2"),
    (r"^(\S+): 1 validation error for \w+ Value error, (.*?) \[type=.*", r"--\1: \2"),  # several together
    (
        r"^(\S+): \d+ validation errors? for \w+ (\S+) (.*?) \[type=.*?input_value=(.*?), input_type.*",
        r"--\1.\2: \3, got \4",
    ),
    (r": Input", ": input"),
    (r": Value error, ", ": "),
)
"""Words of Tyro and of the parsers below it → ours. What is not listed is shown as it comes."""

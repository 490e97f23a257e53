"""The command line: `exosight simulate | generate | train | evaluate | control | study`.

Whatever a user can do wrong ends in one sentence on stderr and exit code 2.
"""

import os
import sys
from collections.abc import Sequence

import pydantic
import tyro

from exosight import __version__
from exosight.app.commands.control import control
from exosight.app.commands.evaluate import evaluate
from exosight.app.commands.generate import generate
from exosight.app.commands.simulate import simulate
from exosight.app.commands.study import study
from exosight.app.commands.train import train
from exosight.errors import ExosightError

COMMANDS = {
    "simulate": simulate,
    "generate": generate,
    "train": train,
    "evaluate": evaluate,
    "control": control,
    "study": study,
}

DESCRIPTION = f"""exosight {__version__}: contact forces of a soft finger exosuit from a plain camera image.

The whole published system on small input:   exosight study --preset quick --out results/quick
One exosuit under four loads:                exosight simulate --u 0 1 2.4 4
Step by step:                                generate, train, evaluate, control"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one command; never returns an exit code other than 0, 1 (a bug), 2 (wrong use) or 130 (stopped)."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    if arguments == ["--version"]:
        print(f"exosight {__version__}")
        return
    try:
        tyro.extras.subcommand_cli_from_dict(
            COMMANDS,
            prog="exosight",
            description=DESCRIPTION,
            args=arguments or ["--help"],
            use_underscores=False,
        )
    except ExosightError as error:
        _fail(str(error))
    except pydantic.ValidationError as error:
        fault = error.errors()[0]
        name = "-".join(str(part) for part in fault["loc"]).replace("_", "-")
        _fail(f"--{name}: {fault['msg'][0].lower()}{fault['msg'][1:]}, got {str(fault['input'])[:80]}")
    except BrokenPipeError:
        # The reader of our output (head, less) has gone; nothing is wrong.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except KeyboardInterrupt:
        print("exosight: stopped", file=sys.stderr)
        sys.exit(130)
    except OSError as error:
        _fail(f"{error.filename or 'file'}: {error.strerror or error}")
    except Exception as error:
        if os.environ.get("EXOSIGHT_TRACEBACK"):
            raise
        print(
            f"exosight: a bug in exosight ({type(error).__name__}: {error}); "
            "please report it with the output of the same command under EXOSIGHT_TRACEBACK=1",
            file=sys.stderr,
        )
        sys.exit(1)


def _fail(sentence: str) -> None:
    print(f"exosight: {' '.join(sentence.split())}", file=sys.stderr)
    sys.exit(2)

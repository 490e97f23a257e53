"""The command line: `exosight simulate | generate | train | …`.

Whatever a user can do wrong ends in one sentence on stderr and exit code 2.
"""

import difflib
import errno
import io
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from importlib import import_module
from inspect import signature
from keyword import iskeyword

from exosight import __version__
from exosight.app.stopping import STOP, stoppable
from exosight.errors import ExosightError, InputError, printable

COMMANDS = {
    "system": "what is simulated: presets, and files of your own",
    "simulate": "equilibria of one exosuit under given loads",
    "generate": "a dataset of labelled images from simulation",
    "import": "a dataset from pictures and readings of your own",
    "segment": "masks of the bodies in photographs",
    "calibrate": "the camera of a system file, from the device at rest or a board",
    "identify": "the model of a rig from pictures of it at known loads",
    "train": "a network from a dataset",
    "adapt": "a network changed by a few labels of another set-up",
    "estimate": "contact forces from images",
    "evaluate": "accuracy of a network, beside the paper's",
    "control": "the closed loop, with a network or the true force as sensor",
    "live": "the loop in real time, with a camera or a simulated exosuit",
    "replay": "a recorded run through network and guard once more",
    "stress": "the controllers in random episodes with disturbances",
    "study": "all of it, from simulation to one report",
    "bench": "equilibria a second on this machine",
    "export": "a dataset or a simulated path for MATLAB and other programs",
    "lab": "a local web page with sliders for a system, its image and sensors",
    "doctor": "what is installed, what works, what is missing",
}

HELP = f"""exosight {__version__}: contact forces of a soft finger exosuit from a camera image

usage: exosight COMMAND [OPTIONS]

Commands
{chr(10).join(f"  {name:<10}{words}" for name, words in COMMANDS.items())}

The whole published system on small input, in minutes
  exosight study --preset quick --out results/quick

One exosuit under four loads
  exosight simulate --u 0 1 2.4 4

The forces in an image
  exosight estimate image.png

A force held in real time, with a camera or in simulation
  exosight live --source 0 --target 0.3 --record run.h5

A page with sliders
  exosight lab

Step by step
  exosight generate --out results/data
  exosight train    --data results/data --out results/light
  exosight evaluate --data results/data --model results/light/model.onnx
  exosight control  --model results/light/model.onnx

exosight COMMAND --help explains a command, exosight --version tells the version"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one command; exit codes are 0, 1 (a bug), 2 (wrong use), or 128 and the signal that stopped it.

    arguments   by default those of the process, which then does nothing else: a signal ends it
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without "…" or "π" shows "?"
    # A home that cannot be written, or a cache cut short: JAX then compiles anew, which is all that it takes.
    warnings.filterwarnings("ignore", message="Error (reading|writing) persistent compilation cache")
    try:
        with stoppable(watched=arguments is None):
            _run(sys.argv[1:] if arguments is None else list(arguments))
            sys.stdout.flush()  # here, where a full disk or a closed pipe can still be told
    except BrokenPipeError:
        _silence_stdout()  # the reader of our output (head, less) has gone; nothing is wrong
    except KeyboardInterrupt:
        if arguments is None:
            STOP.end()
        print(f"exosight: {STOP.words}", file=sys.stderr)
        sys.exit(STOP.exit_code)
    except ExosightError as error:
        _fail(str(error))
    except MemoryError as error:
        _fail(f"not enough memory ({error}); choose less at once, or smaller images")
    except OSError as error:
        _silence_stdout()
        _fail(_sentence_of(error))
    except Exception as error:
        if os.environ.get("EXOSIGHT_TRACEBACK"):
            raise
        print(
            f"exosight: a bug in exosight ({type(error).__name__}: {printable(str(error))}); "
            "please report it with the output of the same command under EXOSIGHT_TRACEBACK=1",
            file=sys.stderr,
        )
        sys.exit(1)


def command_of(name: str) -> Callable[..., None]:
    """The function of a command; of one whose name Python keeps for itself it has a _ behind."""
    word = f"{name}_" if iskeyword(name) else name
    return getattr(import_module(f"exosight.app.commands.{word}"), word)


def _run(arguments: list[str]) -> None:
    name, *options = arguments or ["--help"]
    if name in ("-h", "--help"):
        print(HELP)
    elif name == "--version":
        print(f"exosight {__version__}")
    elif name in COMMANDS:
        # Only now: each command imports what its options need.
        from exosight.app.options import read_options

        command = command_of(name)
        if "resume" in signature(command).parameters:
            STOP.words = "stopped; the same command with --resume goes on"
        chosen = read_options(command, options)
        if chosen is not None:
            chosen()
    else:
        close = difflib.get_close_matches(name, COMMANDS, n=1)
        remedy = f"perhaps you meant {close[0]}" if close else "see exosight --help"
        raise InputError(f"expected a command, one of {', '.join(COMMANDS)}, got {name!r}; {remedy}")


def _sentence_of(error: OSError) -> str:
    what = f"{error.filename or 'output'}: {error.strerror or error}"
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return f"{what}; make room and run the same command again, with --resume where it has one"
    return what


def _silence_stdout() -> None:
    """Keep Python from trying once more, while it shuts down, to write what nobody can read."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _fail(sentence: str) -> None:
    print(f"exosight: {printable(' '.join(sentence.split()))}", file=sys.stderr)
    sys.exit(2)

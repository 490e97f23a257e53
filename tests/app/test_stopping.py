"""A signal ends a command, whatever it is doing: in processes of their own, which it ends."""

import signal
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from exosight.app.stopping import Stopped, stoppable

PROGRAM = """
import ctypes, signal, sys, time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from exosight.app.commands import generate
from exosight.app.main import main
from exosight.app.output import new_folder

def ready():
    print("ready", flush=True)

def finaliser():
    class Closed:
        def __del__(self):
            ready()
            time.sleep(60)
    Closed()  # what its finaliser raises is dropped
    time.sleep(60)

def threads():
    with new_folder(Path("results")) as part, ThreadPoolExecutor() as pool:  # which waits for its threads
        (part / "half").write_text("written")
        pool.submit(ctypes.CDLL(None).sleep, 60)
        ready()

def imports():
    try:
        ready()
        time.sleep(60)
    except KeyboardInterrupt as error:
        raise ImportError("something cannot be imported") from error

work = globals()[sys.argv.pop()]

def command(resume: bool = False) -> None:
    work()

generate.generate = command
signal.signal(signal.SIGINT, signal.default_int_handler)  # which background jobs of shells ignore
main()
"""


@pytest.mark.parametrize(
    ("work", "kind"),
    [("finaliser", signal.SIGINT), ("threads", signal.SIGTERM), ("imports", signal.SIGINT)],
)
def test_a_signal_ends_a_command_whatever_it_is_doing(
    work: str, kind: signal.Signals, tmp_path: Path
) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "generate", work],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    process.send_signal(kind)
    told = process.communicate(timeout=50)[1]  # less than the work takes
    assert process.returncode == 128 + kind
    assert told.splitlines() == ["exosight: stopped; the same command with --resume goes on"]
    assert list(tmp_path.iterdir()) == []


def test_no_import_is_broken_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Native modules abort the process where Python raises within them; the command stops all the same."""
    source = "import os, signal\nos.kill(os.getpid(), signal.SIGTERM)\nwhole = True\n"
    (tmp_path / "signalled.py").write_text(source, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    whole = []
    with pytest.raises(Stopped), stoppable(watched=False):
        whole.append(import_module("signalled").whole)
    assert whole == [True]

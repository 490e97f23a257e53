"""Commands stopped and killed at random moments: `python -m benchmarks.kill`; half an hour on two cores.

Ctrl-C: `generate` and `train` have to end within seconds with exit code 130. kill -9: what `generate` and
`train` had finished is kept, the end result after --resume is that of a run without a stop to the last bit,
and a recording of `live` holds all that a reader found in it just before.
"""

import argparse
import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from exosight.app.pipeline import MODEL
from exosight.control.estimator import DEFAULT_MODEL, OnnxEstimator
from exosight.control.recording import read_recording
from exosight.control.replay import replay
from exosight.dataset.generation import DESIGNS_PER_CHUNK
from exosight.dataset.manifest import MANIFEST
from exosight.errors import DataError
from exosight.learning.checkpoint import CHECKPOINT_NAME, load_checkpoint

RESULT = Path(__file__).parents[1] / "docs" / "results" / "kill.json"
PROGRAM = (sys.executable, "-c", "from exosight.app.main import main; main()")
RECORDED = 10
"""Length of a recording that is not stopped [s]."""
LIMIT = 300.0
"""Longest run of a command [s]."""


def start(*words: object) -> subprocess.Popen[str]:
    """A command in a process of its own, which Ctrl-C stops also where it does not stop this one."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        return subprocess.Popen(
            [*PROGRAM, *map(str, words)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
    finally:
        signal.signal(signal.SIGINT, before)


def complete(*words: object) -> None:
    """Run a command to its end."""
    process = start(*words)
    told = process.communicate(timeout=LIMIT)[1]
    if process.returncode:
        raise RuntimeError(f"{words}: exit code {process.returncode}: {told}")


def duration(words: Callable[[Path], tuple], place: Path) -> float:
    """How long a command takes without a stop [s], once what it compiles is cached."""
    complete(*words(place / "first"))
    started = time.monotonic()
    complete(*words(place / "whole"))
    return time.monotonic() - started


def send(
    process: subprocess.Popen[str], kind: signal.Signals, moment: float
) -> tuple[int, float, str] | None:
    """A signal at a moment [s]: exit code, time to the end [s] and last words; None if the end came first."""
    try:
        process.wait(moment)
    except subprocess.TimeoutExpired:
        sent = time.monotonic()
        process.send_signal(kind)
        words = process.communicate(timeout=LIMIT)[1]
        return process.returncode, time.monotonic() - sent, (words.splitlines() or [""])[-1]
    process.communicate()
    if process.returncode:
        raise RuntimeError(f"exit code {process.returncode} without a signal")
    return None


def interrupted(words: Callable[[Path], tuple], place: Path, moments: int, rng: np.random.Generator) -> dict:
    """Ctrl-C at random moments of a command, each in a folder of its own.

    Exit code −2 is Python's own, before it has read the program: shells show 130 for it as well.
    """
    seconds = duration(words, place)
    codes: Counter[str] = Counter()
    times, named, tries, late = [], 0, 0, 0
    while len(times) < moments:
        tries += 1
        folder = place / f"c{tries}"
        found = send(start(*words(folder)), signal.SIGINT, rng.uniform(0, seconds))
        if found is None:
            continue
        if found[0] == 0 and any((folder / name).exists() for name in (MANIFEST, MODEL)):
            late += 1  # all was written, and Python on its way out
            continue
        codes[str(found[0])] += 1
        times.append(found[1])
        named += "--resume" in found[2]
    return {
        "moments": moments,
        "run_without_stop_s": round(seconds, 1),
        "exit_codes": dict(codes),
        "signals_after_the_result": late,
        "named_resume": named,
        "seconds_to_stop": {"median": round(float(np.median(times)), 2), "largest": round(max(times), 2)},
    }


@dataclass(frozen=True)
class Resumable:
    """A command that goes on with what a folder holds.

    words      for a folder, which is begun or resumed
    finished   parts of the work that a folder holds, of which none may go
    result     what has to be equal at the end
    """

    words: Callable[[Path], tuple]
    finished: Callable[[Path], set]
    result: Callable[[Path], object]


def killed(command: Resumable, seconds: float, place: Path, moments: int, rng: np.random.Generator) -> dict:
    """kill -9 at random moments, each run going on from the one before until it is complete, then anew.

    seconds   that it takes without a stop; the folder "whole" of the place holds what it then ends with
    """
    expected = command.result(place / "whole")
    kills = lost = runs = differ = 0
    folder, had = place / "k0", set[object]()
    while kills < moments:
        if send(start(*command.words(folder)), signal.SIGKILL, rng.uniform(0, seconds)) is not None:
            kills += 1
            has = command.finished(folder)
            lost, had = lost + len(had - has), has
            if kills < moments:
                continue
            complete(*command.words(folder))
        differ += command.result(folder) != expected
        runs += 1
        folder, had = place / f"k{runs}", set()
    return {
        "moments": kills,
        "run_without_stop_s": round(seconds, 1),
        "runs_completed": runs,
        "finished_parts_lost": lost,
        "results_that_differ": differ,
    }


def solved_designs(folder: Path) -> set[tuple[str, int]]:
    """The designs that a dataset in the making keeps, by chunk and place in it."""
    found: set[tuple[str, int]] = set()
    for record in folder.glob("chunk_*.json"):
        found |= {(record.stem, i) for i in range(DESIGNS_PER_CHUNK)}
    for file in folder.glob("chunk_*.npz"):
        with np.load(file) as content:
            found |= {(file.stem, int(i)) for i in content["numbers"]}
    return found


def checksums(folder: Path) -> dict[str, str]:
    """Of every file of a dataset, by name."""
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}


def steps_done(folder: Path) -> set[int]:
    """The steps of training that a checkpoint holds."""
    if not (folder / CHECKPOINT_NAME).exists():
        return set()
    return set(range(load_checkpoint(folder).position.step))


def trained(folder: Path) -> tuple:
    """What a complete run has learned: its losses, and every tensor of its checkpoint to the last bit."""
    checkpoint = load_checkpoint(folder)
    tensors = {name: tensor.numpy().tobytes() for name, tensor in checkpoint.tensors.items()}
    losses = [(r.epoch, r.step, r.train_loss, r.validation_loss) for r in checkpoint.history]
    return tensors, losses, checkpoint.position.complete


def recordings(place: Path, moments: int, rng: np.random.Generator) -> dict:
    """kill -9 at random moments of recordings that are being written.

    Every step that was in the file just before has to be in it afterwards, once.
    """
    network = OnnxEstimator.load(DEFAULT_MODEL, alone=True)
    kills, rows, lost, unreadable, differ = 0, [], 0, 0, 0
    while kills < moments:
        file = place / f"r{time.monotonic_ns()}.h5"
        process = start(*recorded(file))
        begun = time.monotonic()
        while not file.exists() and process.poll() is None and time.monotonic() - begun < LIMIT:
            time.sleep(0.01)
        try:
            process.communicate(timeout=rng.uniform(0, RECORDED))
            continue  # the end came first
        except subprocess.TimeoutExpired:
            kills += 1
        try:
            before = read_recording(file).time
            process.kill()
            process.communicate(timeout=LIMIT)
            recording = read_recording(file)
            again = replay(recording, network.read)
        except DataError as error:
            print(error)
            unreadable += 1
            process.kill()
            continue
        after = recording.time
        rows.append(len(after))
        differ += not np.array_equal(again.estimated, recording.estimated)
        whole = len(after) >= len(before) and np.array_equal(after[: len(before)], before)
        lost += not (whole and np.all(np.diff(after) > 0))
    return {
        "moments": kills,
        "recorded_s": RECORDED,
        "replayed": len(rows),
        "steps_replayed": sum(rows),
        "unreadable": unreadable,
        "with_steps_lost_or_doubled": lost,
        "replays_that_differ": differ,
    }


def recorded(file: Path) -> tuple:
    """The command that records a simulated run."""
    return "live", "--seconds", RECORDED, "--rate", 20, "--record", file


def run(moments: int, seed: int = 0) -> dict:
    """All of it, so many moments each."""
    rng = np.random.default_rng(seed)
    found: dict = {"cores": os.cpu_count(), "load_before": round(os.getloadavg()[0], 2)}
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)

        def generating(folder: Path) -> tuple:
            return "generate", "--per-scenario", 1, "--frames", 10, "--resume", "--out", folder

        def training(folder: Path) -> tuple:
            data = ("--data", place / "generate" / "whole", "--epochs", 4, "--threads", 1)
            return "train", *data, "--resume", "--out", folder

        dataset = Resumable(generating, solved_designs, checksums)
        network = Resumable(training, steps_done, trained)
        for title, measure in (
            ("generate", lambda at: killed(dataset, duration(generating, at), at, moments, rng)),
            ("generate_ctrl_c", lambda at: interrupted(generating, at, moments, rng)),
            ("train", lambda at: killed(network, duration(training, at), at, moments, rng)),
            ("train_ctrl_c", lambda at: interrupted(training, at, moments, rng)),
            ("recording", lambda at: recordings(at, moments, rng)),
        ):
            (place / title).mkdir()
            found[title] = measure(place / title)
            print(title, found[title], flush=True)
    return found


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--moments", type=int, default=30)
    found = run(parser.parse_args().moments)
    RESULT.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()

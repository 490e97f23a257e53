"""The short form of `benchmarks.kill`: a dataset in the making, killed, ends as one that was not."""

import time
from pathlib import Path

import numpy as np
from benchmarks import kill

THUMB = Path(__file__).parents[1] / "examples" / "systems" / "thumb.toml"


def test_killed_datasets_lose_nothing_and_end_the_same(tmp_path: Path) -> None:
    def words(folder: Path) -> tuple:
        small = ("--designs", 2, "--frames", 5)
        return "generate", "--system", THUMB, *small, "--resume", "--out", folder

    command = kill.Resumable(words, kill.solved_designs, kill.checksums)
    started = time.monotonic()
    kill.complete(*words(tmp_path / "whole"))
    seconds = time.monotonic() - started
    found = kill.killed(command, seconds, tmp_path, 1, np.random.default_rng(0))
    assert found["moments"] == 1
    assert found["finished_parts_lost"] == found["results_that_differ"] == 0

"""The short form of `benchmarks.kill`: a dataset in the making, killed twice, ends as one that was not."""

from pathlib import Path

import numpy as np
from benchmarks import kill

THUMB = Path(__file__).parents[1] / "examples" / "systems" / "thumb.toml"


def test_killed_datasets_lose_nothing_and_end_the_same(tmp_path: Path) -> None:
    def words(folder: Path) -> tuple:
        small = ("--designs", 2, "--frames", 5)
        return "generate", "--system", THUMB, *small, "--resume", "--out", folder

    command = kill.Resumable(words, kill.solved_designs, kill.checksums)
    found = kill.killed(command, tmp_path, 2, np.random.default_rng(0))
    assert found["moments"] == 2
    assert found["finished_parts_lost"] == found["results_that_differ"] == 0

"""Mutations of valid files; `python -m benchmarks.fuzz_system` makes ten thousand of them."""

from pathlib import Path

from benchmarks.fuzz_system import fuzz


def test_mutations_are_systems_or_refused_in_a_sentence(tmp_path: Path) -> None:
    found, _ = fuzz(150, seed=5, folder=tmp_path)
    assert set(found) == {"system", "refused", "not read"}
    assert sum(found.values()) == 150

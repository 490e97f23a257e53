"""Mutated inputs of all kinds; `python -m benchmarks.fuzz` makes a million of them.

Networks and the page have fuzzers of their own, in `learning/test_model_graph.py` and `lab/test_server.py`.
"""

from pathlib import Path

import pytest
from benchmarks.fuzz import outcomes


@pytest.mark.parametrize(
    ("name", "count"), [("system", 100), ("recording", 100), ("dataset", 60), ("picture", 1000)]
)
def test_inputs_are_read_or_refused_in_a_sentence(tmp_path: Path, name: str, count: int) -> None:
    """Whatever else happens is raised here."""
    found = outcomes(name, count, seed=5, folder=tmp_path)
    assert found["accepted"] > 0.02 * count
    assert found["refused"] > 0.3 * count


def test_command_lines_are_understood_or_refused_in_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from exosight.app import options

    monkeypatch.setattr(options, "read_options", options.read_options)  # which the fuzzer replaces
    monkeypatch.setenv("EXOSIGHT_TRACEBACK", "1")
    monkeypatch.chdir(tmp_path)
    found = outcomes("command", 100, seed=5, folder=tmp_path)
    assert found["accepted"] > 10
    assert found["refused"] > 10

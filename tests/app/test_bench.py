"""The benchmark's numbers hang together; how large they are is the machine's affair."""

import pytest

from exosight.app import bench as module
from exosight.app.bench import FLOOR, bench


def test_the_numbers_hang_together(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_first_calls", lambda: (2.0, 1.0))  # two new processes, several seconds each
    monkeypatch.setattr(module, "REPEATS", 1)  # eleven paths take ten seconds
    steps: list[tuple[int, int]] = []
    found = bench(1, lambda done, total: steps.append((done, total)))
    assert (found.shapes, found.equilibria) == (11, 11 * 51)
    assert found.converged == 1
    assert found.snaps > 0  # thin exosuits do
    assert found.equilibria_per_second * found.seconds == pytest.approx(found.equilibria)
    iterations = found.iterations_mean * found.equilibria
    assert found.microseconds_per_iteration == pytest.approx(1e6 * found.seconds * found.cores / iterations)
    least = FLOOR * iterations / (1e9 * found.matrix_product_rate)  # what the arithmetic alone would take [s]
    assert found.share_of_floor == pytest.approx(least / found.seconds)
    assert 0 < found.share_of_floor < 1
    assert found.first_call_seconds == 2
    assert steps[-1] == (4, 4)

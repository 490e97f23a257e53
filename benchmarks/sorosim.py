"""How closely SoRoSim's solutions are met: `python -m benchmarks.sorosim` writes docs/results/sorosim.json.

It runs the tests that compare, and notes every difference that they check beside the tolerance for it.
"""

import json
from collections.abc import Generator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "docs" / "results" / "sorosim.json"
TESTS = ("tests/mechanics/test_sorosim.py", "tests/mechanics/test_dynamics.py")


class Differences:
    """A plugin of pytest: for each test and tolerance, the largest difference that `assert_allclose` saw."""

    def __init__(self) -> None:
        self.rows: list[dict[str, Any]] = []

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Generator[None, Any, Any]:
        """Run one test with the comparison watched."""
        largest: dict[float, float] = {}
        compare = np.testing.assert_allclose

        def watched(actual: Any, desired: Any, rtol: float = 1e-7, atol: float = 0, **rest: Any) -> None:
            difference = float(np.max(np.abs(np.asarray(actual) - np.asarray(desired))))
            largest[atol] = max(largest.get(atol, 0.0), difference)
            compare(actual, desired, rtol=rtol, atol=atol, **rest)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(np.testing, "assert_allclose", watched)
            result = yield
        self.rows += [
            {"test": item.name, "tolerance": tolerance, "difference": difference}
            for tolerance, difference in largest.items()
        ]
        return result


def main() -> None:
    """Run the tests and write what they saw."""
    seen = Differences()
    if pytest.main([*(str(ROOT / test) for test in TESTS), "-q", "-k", "sorosim"], plugins=[seen]) != 0:
        raise SystemExit("a comparison with SoRoSim failed; nothing written")
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps(seen.rows, indent=1) + "\n")
    print(json.dumps(seen.rows, indent=1))


if __name__ == "__main__":
    main()

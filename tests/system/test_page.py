"""docs/systems.md says what files may say, and its examples work."""

import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from exosight.exosuit.catalogue import nominal_system
from exosight.system import description, units
from exosight.system.simulation import simulate_system

PAGE = (Path(__file__).parents[2] / "docs" / "systems.md").read_text(encoding="utf-8")
TABLES = [
    *(
        description.RodTable,
        description.RelaxationTable,
        description.RadiusProfile,
        description.LinkTable,
        description.JointTable,
    ),
    *(description.SurfaceTable, description.ContactTable, description.ActuatorTable),
    *(description.SensorTable, description.CameraTable, description.VaryTable, description.Description),
]


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.__name__)
def test_every_entry_is_explained(table: type) -> None:
    missing = [field.name for field in fields(table) if not re.search(rf"[`\[.]{field.name}[`.\]]", PAGE)]
    assert not missing


def test_every_unit_is_listed() -> None:
    rows = dict(re.findall(r"^\| ([a-z ]+?)(?: \(commands\))? \| ([^|]+) \| ", PAGE, flags=re.MULTILINE))
    kinds = [each for each in vars(units).values() if isinstance(each, units.Kind)]
    for kind in kinds:
        row = rows[kind.name.split(" ", 1)[1]].split(", ")
        assert set(row) <= set(kind.units)
        # Other spellings of a unit that is listed are left out.
        assert {kind.units[unit] for unit in row} == set(kind.units.values())


def test_the_example_presses(tmp_path: Path) -> None:
    (text,) = re.findall(r"```toml\n(.*?)```", PAGE, flags=re.DOTALL)
    (tmp_path / "lever.toml").write_text(text, encoding="utf-8")
    answer = simulate_system(nominal_system(str(tmp_path / "lever.toml")), np.array([[0.0], [30.0], [60.0]]))
    assert np.all(answer.equilibria.converged)
    force = np.asarray(answer.observation.readings)[:, 0]
    assert force[0] == 0
    assert 0.05 < force[1] < force[2]


def test_python_code_runs(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)
    monkeypatch.chdir(Path(__file__).parents[2])
    exec(compile(code, "systems.md", "exec"), {})
    assert "('P1', 'P2', 'P3') [ True  True]" in capsys.readouterr().out

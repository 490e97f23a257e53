"""`exosight doctor`: what it says of this installation is so, and a broken one is told by its exit code."""

import json
import tomllib
from collections.abc import Callable
from importlib import metadata
from pathlib import Path

import pytest

from exosight import __version__
from exosight.app import doctor
from exosight.app.main import main


def test_it_reports_this_installation(capsys: pytest.CaptureFixture[str]) -> None:
    main(["doctor", "--json", "-"])
    found = json.loads(capsys.readouterr().out)
    assert found["works"]
    assert found["version"] == __version__
    core = {package["name"]: package for package in found["core"]}
    assert core["numpy"]["installed"] == metadata.version("numpy")
    assert all(package["fits"] for package in core.values())
    assert found["estimator"].endswith("answer")
    assert "cpu" in found["jax"] or "gpu" in found["jax"] or "cuda" in found["jax"]
    assert found["cores"] >= 1
    assert found["disk"] > 0
    offered = metadata.metadata("exosight").get_all("Provides-Extra") or []
    assert {extra["name"] for extra in found["extras"]} == set(offered) >= {"train", "test"}


def test_tables_name_the_remedy(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    needs = ["numpy>=2", 'a-package-that-is-not>=1; extra == "train"']
    monkeypatch.setattr(metadata, "requires", lambda name: needs)
    main(["doctor"])
    shown = capsys.readouterr()
    assert "a-package-that-is-not" in shown.out
    assert doctor.GIVES["train"].split()[0] in shown.out
    assert "pip install 'exosight[train]'" in shown.err


@pytest.mark.parametrize("need", ["numpy>=99", "a-package-that-is-not"])
def test_a_broken_core_ends_in_exit_code_2(
    need: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(metadata, "requires", lambda name: [need])
    with pytest.raises(SystemExit) as end:
        main(["doctor"])
    assert end.value.code == 2
    assert need.split(">")[0] in capsys.readouterr().err


def test_a_network_that_does_not_answer_is_a_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("exosight.control.estimator.SHIPPED_MODELS", {"index": tmp_path / "none.onnx"})
    with pytest.raises(SystemExit) as end:
        main(["doctor"])
    assert end.value.code == 2
    assert "shipped network does not work" in capsys.readouterr().err


def test_a_driver_that_raises_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(name: str) -> None:
        raise RuntimeError("no driver\nand more")

    monkeypatch.setattr(doctor, "import_module", broken)
    found = doctor.examine()
    assert found.jax == found.torch == "does not work: no driver"
    assert found.works  # the core needs neither to estimate


def test_requirements_are_told_apart() -> None:
    core, extras = doctor.packages(
        ["numpy>=2", 'torch>=99; extra == "train"', 'h5py; python_version > "3" and extra == "other"']
    )
    assert [package.name for package in core] == ["numpy"]
    assert {extra.name: extra.missing for extra in extras} == {"train": ("torch",), "other": ()}


def test_every_extra_says_what_it_gives() -> None:
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    assert set(project["optional-dependencies"]) <= set(doctor.GIVES)


def test_cache_that_cannot_be_made_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path / "file" / "jax"))
    assert "cannot be written" in doctor.examine().cache
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path / "jax"))
    assert doctor.examine().cache == f"{tmp_path / 'jax'}, 0.0 MiB"


def test_wrong_options_are_refused(refused: Callable[..., str]) -> None:
    assert "unknown option" in refused("doctor", "--what")

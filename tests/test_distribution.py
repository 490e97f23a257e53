"""Wheel and sdist: built, installed into a clean environment, and tried outside of the source tree.

Downloads all of the core's dependencies, so it runs only when asked: `make dist`, or EXOSIGHT_TEST_WHEEL=1.
"""

import json
import os
import subprocess
import sys
import tarfile
import venv
import zipfile
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
ASKED = os.environ.get("EXOSIGHT_TEST_WHEEL", "")

pytestmark = pytest.mark.skipif(
    not ASKED, reason="installs everything anew, which takes minutes and the network: make dist runs it"
)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder with wheel and sdist: the one that was named, or built now."""
    if (ROOT / ASKED).is_dir():
        return ROOT / ASKED
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    subprocess.run(command, check=True, capture_output=True)
    return folder


@pytest.fixture(scope="module")
def exosight(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The command, in an environment of its own that holds the wheel and what the core needs."""
    folder = tmp_path_factory.mktemp("clean")
    venv.create(folder, with_pip=True)
    (wheel,) = built.glob("*.whl")
    pip = [str(folder / "bin" / "python"), "-m", "pip", "install", "--quiet"]
    subprocess.run([*pip, "-c", str(ROOT / "constraints.txt"), str(wheel)], check=True)
    return folder / "bin" / "exosight"


def run(exosight: Path, place: Path, *words: str) -> str:
    """What a command prints, run in a folder far from the source, with nothing inherited that leads there."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "EXOSIGHT"))}
    done = subprocess.run(
        [exosight, *words], cwd=place, capture_output=True, text=True, env=environment, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_wheel_holds_the_package_alone(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as file:
        names = file.namelist()
    assert {name.split("/")[0].split("-")[0] for name in names} == {"exosight"}
    for needed in ("py.typed", "models/light.onnx", "models/README.md", "dataset/card.md"):
        assert f"exosight/{needed}" in names
    assert any(name.endswith("licenses/LICENSE") for name in names)


def test_the_sdist_holds_what_its_tests_need(built: Path) -> None:
    (sdist,) = built.glob("*.tar.gz")
    with tarfile.open(sdist) as file:
        names = {name.partition("/")[2] for name in file.getnames()}
    for needed in ("constraints.txt", "Makefile", "docs/conf.py", "tests/conftest.py", "tools/setup.sh"):
        assert needed in names
    assert not any("__pycache__" in name or name.startswith("results") for name in names)


def test_the_core_works_outside_of_the_source(exosight: Path, tmp_path: Path) -> None:
    assert run(exosight, tmp_path, "--version").startswith("exosight ")
    health = json.loads(run(exosight, tmp_path, "doctor", "--json", "-"))
    assert health["works"]
    assert {extra["name"]: extra["missing"] for extra in health["extras"]}["train"]
    path = json.loads(run(exosight, tmp_path, "simulate", "--u", "0", "2.4", "--json", "-"))["path"]
    assert all(record["converged"] for record in path)
    run(exosight, tmp_path, "generate", "--out", "data", "--per-scenario", "1", "--frames", "5")
    run(exosight, tmp_path, "export", "--data", "data", "--out", "tables")
    pictures = sorted(str(path) for path in (tmp_path / "tables" / "images").iterdir())
    found = json.loads(run(exosight, tmp_path, "estimate", *pictures[:4], "--json", "-"))["estimates"]
    assert len(found) == 4
    assert np.isfinite([each["F_net_N"] for each in found]).all()

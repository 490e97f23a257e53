"""The README keeps its word: its code runs, its commands and links exist."""

import re
from pathlib import Path

import pytest

from exosight import __version__
from exosight.app.main import COMMANDS

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()

SMALLER = {"per_scenario=10": "per_scenario=1, young=1e6", "epochs=40": "epochs=1", "steps=50": "steps=3"}
"""What makes the program fast enough to test: fewer and stiffer shapes, fewer epochs and steps."""


def test_python_code_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    for shown, smaller in SMALLER.items():
        assert shown in code
        code = code.replace(shown, smaller)
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "README.md", "exec"), {})
    printed = capsys.readouterr().out.splitlines()
    assert len(printed) == 2
    # One epoch teaches nothing, but the plant obeys: forces are finite and not negative.
    true, estimated = (float(number) for number in printed[1].split())
    assert 0 <= true < 10
    assert 0 <= estimated < 10


def test_every_verb_is_shown() -> None:
    assert set(re.findall(r"^\.venv/bin/exosight (\w+)", README, flags=re.MULTILINE)) == set(COMMANDS)


def test_every_make_command_exists() -> None:
    targets = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), flags=re.MULTILINE))
    for page in ("README.md", "CONTRIBUTING.md"):
        assert set(re.findall(r"(?:^|`)make (\w+)", (ROOT / page).read_text(), flags=re.MULTILINE)) <= targets


@pytest.mark.parametrize("page", ["README.md", "docs/extending.md", "CONTRIBUTING.md"])
def test_links_and_files_exist(page: str) -> None:
    text = (ROOT / page).read_text()
    for link in re.findall(r"\]\(([^)#:]+)\)", text):
        assert ((ROOT / page).parent / link).exists(), link
    for path in re.findall(r"`((?:src|docs|tests|examples|tools|benchmarks)/[\w./]*)`", text):
        assert (ROOT / path).exists(), path


def test_changelog_and_citation_tell_this_version() -> None:
    assert f"## [{__version__}]" in (ROOT / "CHANGELOG.md").read_text()
    assert f"\nversion: {__version__}\n" in (ROOT / "CITATION.cff").read_text()

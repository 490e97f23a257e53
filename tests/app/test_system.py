"""`exosight system`, and `exosight simulate` of systems that are not the published one."""

import json
import subprocess
import sys
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

import cv2
import pytest

from exosight.app.main import main

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples" / "systems"
Refused = Callable[..., str]
Captured = pytest.CaptureFixture[str]


def output(capsys: Captured, *words: object) -> str:
    capsys.readouterr()
    main([str(word) for word in words])
    return capsys.readouterr().out


def test_help_after_an_action_names_all_actions(capsys: Captured) -> None:
    assert "exosight system [-h] {list,show,new,check} NAME|FILE" in output(capsys, "system", "new", "--help")


def test_list_tells_the_presets(capsys: Captured) -> None:
    assert "published" in output(capsys, "system", "list")
    assert "published" in json.loads(output(capsys, "system", "list", "--json", "-"))["presets"]


def test_a_new_file_is_the_thumb_of_the_documentation(
    tmp_path: Path, capsys: Captured, refused: Refused
) -> None:
    path = tmp_path / "mine.toml"
    main(["system", "new", str(path)])
    thumb = (EXAMPLES / "thumb.toml").read_bytes()
    assert path.read_bytes() == thumb == (files("exosight.system") / "template.toml").read_bytes()
    assert output(capsys, "system", "check", path).startswith("ok: thumb: 1 channel, 5 sensors")
    path.write_text("changed")
    assert "exists already" in refused("system", "new", path)
    assert path.read_text() == "changed"


@pytest.mark.parametrize("name", ["published", "thumb", "two_lines", "profile"])
def test_show_tells_and_draws_every_part(name: str, tmp_path: Path, capsys: Captured) -> None:
    which = name if name == "published" else EXAMPLES / f"{name}.toml"
    plot = tmp_path / "system.png"
    shown = json.loads(output(capsys, "system", "show", which, "--json", "-", "--plot", plot))
    assert shown["schema"]["system"] == name
    sensors = [record["sensor"] for record in shown["parts"]["sensors"]]
    assert sensors == [each["name"] for each in shown["schema"]["sensors"]]
    assert ("varied" in shown["parts"]) == (name != "published")
    picture = cv2.imread(str(plot))
    assert picture is not None
    assert picture.std() > 10  # not an empty page
    table = output(capsys, "system", "show", which)
    assert "Load channels" in table
    assert "[mm]" in table


def test_wrong_use_is_refused_in_a_sentence(tmp_path: Path, refused: Refused) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text((EXAMPLES / "thumb.toml").read_text().replace('"300 kPa"', '"300"'))
    for words, sentence in (
        (("check", bad), "rods.sleeve.young: expected a number and its unit, like '300 kPa', got '300'"),
        (("show", "nobody"), "expected published, index, index-friction or a file *.toml, got 'nobody'"),
        (("check",), "expected a preset or a file after it"),
        (("list", "published"), "expected no name"),
        (("check", "published", "--plot", tmp_path / "a.png"), "--plot: it has no effect with check"),
        (("show", "published", "--plot", tmp_path / "a.txt"), "expected a file *.png, *.pdf, *.svg"),
        (("new", tmp_path / "a.txt"), "expected a file *.toml"),
        (("erase", "a.toml"), "expected one of 'list', 'show', 'new', 'check'"),
    ):
        assert sentence in refused("system", *words)
    assert {path.name for path in tmp_path.iterdir()} == {"bad.toml"}


def test_simulate_answers_by_the_names_of_the_file(capsys: Captured) -> None:
    path = EXAMPLES / "two_lines.toml"
    found = json.loads(
        output(
            capsys, "simulate", "--system", path, "--commands", "back=35", "front=35,back=0", "--json", "-"
        )
    )
    assert found["system"] == found["schema"]["system"] == "two_lines"
    down, up = found["path"]
    assert down["commands"] == {"back": 35.0, "front": 0.0}
    assert up["commands"] == {"back": 0.0, "front": 35.0}
    for record in (down, up):
        assert record["converged"]
        assert record["residual"] <= 1e-10
        assert record["min_eigenvalue"] > 0
        assert record["iterations"] > 0
    assert down["readings"]["grip"] == pytest.approx(down["readings"]["inner"] + down["readings"]["outer"])
    # The back line presses on the finger, the front line on the post.
    assert down["readings"]["grip"] > 0.1
    assert down["readings"]["stop"] == 0
    assert up["readings"]["grip"] == 0
    assert up["readings"]["stop"] > 0.1


def test_simulate_takes_u_where_there_is_one_channel(capsys: Captured, refused: Refused) -> None:
    thumb, lines = EXAMPLES / "thumb.toml", EXAMPLES / "two_lines.toml"
    one = json.loads(output(capsys, "simulate", "--system", thumb, "--u", "2", "--json", "-"))
    two = json.loads(output(capsys, "simulate", "--system", thumb, "--commands", "u=2", "u=4", "--json", "-"))
    # Whatever else is asked for; the solver's residual is 1e-10.
    assert one["path"][0]["readings"] == pytest.approx(two["path"][0]["readings"], rel=1e-9)
    for words, sentence in (
        ((lines, "--u", "1"), "has the channels back, front; give --commands back=1,front=1"),
        ((thumb, "--u", "9"), "u: expected -1 to 4 N, got 9"),
        ((thumb, "--commands", "v=1"), "expected NAME=NUMBER"),
        ((thumb, "--commands", "u=a"), "expected a number for u, got 'a'"),
        ((thumb, "--commands", "u=1,u=2"), "at most once"),
        ((thumb, "--u", "1", "--gap", "0.01"), "--gap: an option of presets"),
    ):
        assert sentence in refused("simulate", "--system", *words)


def test_presets_take_an_exosuit_and_refuse_options_without_effect(
    capsys: Captured, refused: Refused
) -> None:
    worn = ("--r0", "0.01", "--r1", "0.005", "--length", "0.095")
    told = json.loads(output(capsys, "simulate", "--system", "index", *worn, "--u", "2.4", "--json", "-"))
    # That of another program, see tests/exosuit/test_index.py.
    assert told["path"][0]["readings"]["F_net"] == pytest.approx(0.188, abs=0.001)
    sentence = refused("simulate", "--system", "index", "--friction", "0.2")
    assert "--friction: has an effect in index-friction alone" in sentence
    sentence = refused("simulate", "--system", "index", "--contact-stiffness", "500")
    assert "--contact-stiffness: has an effect in published alone" in sentence


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.toml")), ids=lambda path: path.stem)
def test_files_of_the_documentation_press_over_their_range(path: Path, capsys: Captured) -> None:
    found = json.loads(output(capsys, "simulate", "--system", path, "--json", "-"))
    assert all(record["converged"] for record in found["path"])
    if path.stem != "two_lines":  # whose lines balance where both are at their end
        assert found["path"][0]["readings"]["F_net"] == pytest.approx(0, abs=1e-9)
        assert found["path"][-1]["readings"]["F_net"] > 0.3


def test_files_are_read_without_jax() -> None:
    program = (
        "import sys\nfrom pathlib import Path\nimport exosight.system as system\n"
        f"system.describe(system.read_system_file(Path({str(EXAMPLES / 'profile.toml')!r})))\n"
        "sys.exit('jax' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", program], check=True, timeout=120)

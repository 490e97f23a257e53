"""exosight stress, on as few and as short episodes as it takes."""

import csv
import json
from pathlib import Path

import pytest

from exosight.app.control_figures import stress_figure
from exosight.app.main import main
from exosight.app.stress import stress_table
from exosight.control.recording import read_recording

THUMB = Path(__file__).parents[2] / "examples" / "systems" / "thumb.toml"
SHORT = ["stress", "--episodes", "10", "--hold-seconds", "1.5", "--release-seconds", "1.1"]


def test_the_folder_holds_summary_episodes_and_figure(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out, told = tmp_path / "stress", tmp_path / "told.json"
    main([*SHORT, "--gains", "1", "--out", str(out), "--json", str(told)])
    found = json.loads((out / "results.json").read_text())
    assert found == json.loads(told.read_text())
    assert found["about"]["episodes"] == 10
    assert found["about"]["model"] is None
    assert found["about"]["config"]["hold_seconds"] == 1.5
    assert set(found["controllers"]) == {"guarded", "K_P = 1"}
    assert found["controllers"]["guarded"]["commands_outside"] == 0
    rows = list(csv.DictReader((out / "K_P_1.csv").read_text().splitlines()))
    assert [row["episode"] for row in rows] == [str(number) for number in range(10)]
    largest = max(float(row["largest_contact"]) for row in rows)
    assert found["controllers"]["K_P = 1"]["largest_contact"]["largest"] == pytest.approx(largest, rel=1e-5)
    assert (out / "stress.svg").stat().st_size > 10_000
    # The table and the figure are those of the numbers on file.
    assert [row[0] for row in stress_table(found).rows] == ["guarded", "K_P = 1"]
    assert len(stress_figure(found).axes) == 4


def test_the_worst_episodes_can_be_replayed(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out, told = tmp_path / "stress", tmp_path / "told.json"
    options = ["--gains", "--model", "shipped", "--save-worst", "10", "--out", str(out), "--json", str(told)]
    main([*SHORT, *options])
    rows = list(csv.DictReader((out / "guarded.csv").read_text().splitlines()))
    recordings = {int(file.stem.removeprefix("guarded_")): file for file in out.glob("guarded_*.h5")}
    assert set(recordings) == set(range(10))
    number = max(recordings, key=lambda i: float(rows[i]["largest_contact"]))
    largest = float(rows[number]["largest_contact"])
    recorded = read_recording(recordings[number])
    assert len(recorded) == 25  # 2.6 s, of which the first step is at rest
    # Forces are those before the step, so the last of them is missing; 6 digits are on file.
    assert 0.5 * largest < recorded.true.max() < largest * (1 + 1e-5)
    capsys.readouterr()
    main(["replay", str(recordings[number])])
    assert "the same estimates, states and commands" in capsys.readouterr().err


def test_a_system_file_has_episodes_of_its_own(tmp_path: Path):
    told = tmp_path / "told.json"
    main([*SHORT, "--system", str(THUMB), "--sensor", "P3", "--json", str(told)])
    found = json.loads(told.read_text())
    assert found["about"]["system"] == "thumb"
    assert found["about"]["sensor"] == {"name": "P3", "unit": "N"}
    low, high = found["about"]["config"]["targets"]
    assert 0 < low < high < found["about"]["contact_limit"]
    (gain,) = found["about"]["gains"]  # half of what the steepest part of the path asks for, not the paper's
    assert set(found["controllers"]) == {"guarded", f"K_P = {gain:g}"}
    assert gain != 5
    assert found["controllers"]["guarded"]["commands_outside"] == 0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--episodes", "0"], "greater than or equal to 1"),
        (["--latency", "0.3", "0.1"], "lower limit first"),
        (["--gains", "-5"], "greater than 0"),
        (["--model", "missing.onnx"], "missing.onnx"),
        (["--system", "missing.toml"], "missing.toml"),
        (["--sensor", "F"], "got 'F'"),
        (["--causes", "3"], "expected the oracle"),
        (["--save-worst", "3"], "expected --model"),
    ],
)
def test_wrong_options_end_in_one_sentence(
    options: list[str], words: str, capsys: pytest.CaptureFixture[str]
):
    with pytest.raises(SystemExit) as end:
        main([*SHORT, *options])
    assert end.value.code == 2
    told = capsys.readouterr().err
    assert words in told
    assert len(told.strip().splitlines()) == 1

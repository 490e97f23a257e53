"""The command line's door: what it helps with, what it refuses, and what it leaves alone."""

import errno
import json
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import exosight
from exosight.app.data import load
from exosight.app.main import COMMANDS, command_of, main
from exosight.app.options import read_options
from exosight.app.provenance import test_part as part_to_judge
from exosight.control.estimator import OnnxEstimator
from exosight.exosuit.published import PublishedDesigns
from exosight.learning.model_file import sealed
from exosight.system.camera import Camera
from exosight.vision import OOD_KINDS

Refused = Callable[..., str]


def started(*words: str, **options) -> subprocess.CompletedProcess[str]:
    """The program in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "exosight", *words], stderr=subprocess.PIPE, text=True, timeout=120, **options
    )


def command(name: str) -> Callable[..., None]:
    return command_of(name)


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


# Help


def test_without_words_it_lists_the_commands(capsys: pytest.CaptureFixture[str]) -> None:
    for words in ([], ["--help"], ["-h"]):
        main(words)
        shown = capsys.readouterr()
        assert shown.err == ""
        for name in COMMANDS:
            assert f"\n  {name}" in shown.out


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    main(["--version"])
    assert capsys.readouterr().out == f"exosight {exosight.__version__}\n"


@pytest.mark.parametrize("name", ["", *COMMANDS])
def test_help_fits_80_columns_and_explains_every_option(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    main([name, "--help"] if name else ["--help"])
    shown = capsys.readouterr()
    assert shown.err == ""
    lines = shown.out.splitlines()
    assert max(map(len, lines)) <= 80
    assert "  exosight " in shown.out
    assert "DESCRIPTION" not in shown.out
    # An option either has its help beside it or in the lines below, indented further.
    for i, line in enumerate(lines):
        if line.startswith("│ --"):
            below = "".join(lines[i : i + 3]).replace(line.split()[1], "", 1)
            assert sum(map(str.isalpha, below)) > 20, line


@pytest.mark.parametrize("name", list(COMMANDS))
def test_examples_in_the_help_can_be_run(name: str) -> None:
    """As far as the options go: each example binds the command."""
    lines = (command(name).__doc__ or "").splitlines()
    examples = [shlex.split(line) for line in lines if line.startswith("      exosight ")]
    assert examples
    for program, verb, *options in examples:
        assert (program, verb) == ("exosight", name)
        assert read_options(command(name), options) is not None


@pytest.mark.parametrize(
    "words", [["--help"], ["simulate", "--help"], ["train", "--help"], ["study", "--foo"]]
)
def test_help_and_wrong_options_wait_for_no_heavy_import(words: list[str]) -> None:
    program = (
        "import sys\nfrom exosight.app.main import main\n"
        "try:\n    main(sys.argv[1:])\nexcept SystemExit:\n    pass\n"
        "heavy = {'jax', 'torch', 'matplotlib', 'onnxruntime'} & set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else 0)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, *words], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr


# Options


def test_negative_numbers_are_numbers() -> None:
    bound = read_options(
        command("simulate"),
        [
            "--family",
            "cosine_sum",
            "--b",
            "-5",
            "-3",
            "-1e-1",
            "-.5",
            "-0",
            "0",
            "-2",
            "--a",
            "-5",
            "--u",
            "-1",
            "2",
        ],
    )
    assert bound is not None
    chosen = bound.keywords  # type: ignore[attr-defined]
    assert chosen["exosuit"].b == (-5, -3, -0.1, -0.5, 0, 0, -2)
    assert chosen["exosuit"].a == -5
    assert chosen["u"] == (-1, 2)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("simulatte", "got 'simulatte'; perhaps you meant simulate"),
        ("draw", f"one of {', '.join(COMMANDS)}, got 'draw'"),
        ("--foo", "got '--foo'"),
        ("simulate --lenght 0.1", "unknown options: --lenght, 0.1; perhaps you meant --length"),
        ("simulate extra", "unknown options: extra"),
        ("simulate --r0", "--r0: expected a value, got none"),
        ("simulate --r0 thick", "--r0: expected FLOAT, got 'thick'"),
        ("simulate --length long", "--length: expected FLOAT, got 'long'"),
        ("simulate --u 1 2 x", "--u: expected numbers, got '1', '2', 'x'"),
        ("generate --out o --frames 1.5", "--frames: expected a whole number, got '1.5'"),
        ("generate --out o --frames 1", "--frames: input should be greater than or equal to 2, got 1"),
        ("generate --out o --young nan", "--young: input should be less than or equal to 1000000000"),
        ("generate --out o --plant.young 2", "--plant.young: expected FLOAT FLOAT, got '2'; see"),
        ("generate --out o --plant.young 2 1", "--plant.young: expected the lower limit first, got (2"),
        ("generate --out o --camera.width 0", "--camera.width: input should be greater than or equal to 1"),
        ("train", "expected --data PATH and --out PATH, got none; see exosight train --help"),
        ("train --data d --out o --network big", "--network: expected one of 'light', 'paper', got 'big'"),
        ("train --data d --out o --protocol random", "--protocol: expected one of 'design'"),
        ("train --data d --out o --epochs 0", "--epochs: input should be greater than or equal to 1, got 0"),
        ("train --data d --out o --split-seed -1", "--split-seed: input should be greater than"),
        ("evaluate --model m --data d --seed -1", "--seed: input should be greater than or equal to 0"),
        ("study --out o --preset huge", "--preset: expected one of 'quick', 'paper', got 'huge'"),
        ("study --out o --preset quick --config c", "expected one of the two, got both"),
    ],
)  # fmt: skip
def test_wrong_options_are_told_in_one_sentence(refused: Refused, words: str, said: str) -> None:
    # Tyro names the choices of an optional one in no fixed order.
    sentence = refused(*words.split()).replace("'paper', 'quick'", "'quick', 'paper'")
    assert said in sentence


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--family square", "families are linear, sine, cosine_sum, sine_cosine, legendre"),
        ("--family sine --r0 0.01", "family sine: expected --r0, --a; missing: --a"),
        ("--family sine_cosine", "missing: --r0, --c, --d, --phi-c, --phi-d"),
        ("--r0 0.01 --r1 0.005 --a -5", "family linear: expected --r0, --r1; not its own: --a"),
        ("--family cosine_sum --b -5 -3", "b expects 7 numbers, got 2"),
        ("--length -0.1", "length must be a number within 0.07…0.11 m, got -0.1"),
        ("--r0 0.02 --r1 0.005", "r0 must be a number within 0.004…0.01 m, got 0.02"),
        ("--r0 nan --r1 0.005", "r0 must be a number within 0.004…0.01 m, got nan"),
        ("--young nan", "young: expected 1000…1e+09 Pa, got nan"),
        ("--contact-stiffness -1", "contact_stiffness: expected 1…1e+06 N/m, got -1.0"),
        ("--gap inf", "gap: expected 0…0.1 m, got inf"),
        ("--u 0 nan", "u: expected finite loads within ±50 N, got nan"),
        ("--u -inf", "u: expected finite loads within ±50 N, got -inf"),
        ("--u", "at least one load"),
    ],
)
def test_impossible_exosuits_and_loads_are_refused(refused: Refused, words: str, said: str) -> None:
    assert said in refused("simulate", *words.split())


# Places


@pytest.mark.parametrize(
    "words",
    [
        "generate --out TAKEN",
        "train --data DATA --out TAKEN",
        "evaluate --model MODEL --data DATA --out TAKEN",
        "evaluate --model MODEL --data DATA --json TAKEN/note",
        "control --out TAKEN",
        "control --json TAKEN/note",
        "study --out TAKEN",
        "study --out TAKEN --resume",
        "simulate --json TAKEN/note",
    ],
)
def test_nothing_is_overwritten(
    refused: Refused, data: Path, run_folder: Path, tmp_path: Path, words: str
) -> None:
    taken = tmp_path / "taken"
    taken.mkdir()
    (taken / "note").write_text("mine")
    places = {"DATA": data, "MODEL": run_folder / "model.onnx", "TAKEN": taken}
    for name, path in places.items():
        words = words.replace(name, str(path))
    sentence = refused(*words.split())
    assert "exists already" in sentence
    assert str(taken) in sentence
    assert contents(tmp_path) == {"taken/note": b"mine"}


@pytest.mark.parametrize(
    "words",
    [
        "generate --out FILE/x/y",
        "train --data DATA --out FILE/x",
        "evaluate --model MODEL --data DATA --out FILE/x",
        "evaluate --model MODEL --data DATA --json FILE/x",
        "control --out FILE/x",
        "study --out FILE/x",
        "simulate --json FILE/x",
        "simulate --json NOWHERE/x",
    ],
)
def test_places_that_cannot_be_written_are_refused(
    refused: Refused, data: Path, run_folder: Path, tmp_path: Path, words: str
) -> None:
    file = tmp_path / "file"
    file.write_text("mine")
    places = {"DATA": data, "MODEL": run_folder / "model.onnx", "FILE": file, "NOWHERE": tmp_path / "nowhere"}
    for name, path in places.items():
        words = words.replace(name, str(path))
    assert str(tmp_path) in refused(*words.split())
    assert contents(tmp_path) == {"file": b"mine"}


# Datasets


def drop_everything(folder: Path) -> None:
    shutil.rmtree(folder)


def drop_manifest(folder: Path) -> None:
    (folder / "manifest.json").unlink()


def cut_manifest(folder: Path) -> None:
    os.truncate(folder / "manifest.json", 300)


def drop_chunk(folder: Path) -> None:
    (folder / "chunk_0000.h5").unlink()


def cut_chunk(folder: Path) -> None:
    os.truncate(folder / "chunk_0000.h5", 1000)


def alter_chunk(folder: Path) -> None:
    content = bytearray((folder / "chunk_0000.h5").read_bytes())
    content[len(content) // 2] ^= 1
    (folder / "chunk_0000.h5").write_bytes(content)


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (drop_everything, "no such folder; expected a dataset"),
        (drop_manifest, "incomplete dataset"),
        (cut_manifest, "truncated or damaged"),
        (drop_chunk, "missing, the manifest lists it"),
        (cut_chunk, "truncated or altered"),
        (alter_chunk, "altered, its checksum is not that of the manifest"),
    ],
)
@pytest.mark.parametrize("verb", ["train", "evaluate"])
def test_missing_or_damaged_datasets_are_refused(
    refused: Refused, data: Path, run_folder: Path, tmp_path: Path, damage: Callable, said: str, verb: str
) -> None:
    shutil.copytree(data, tmp_path / "copy")
    damage(tmp_path / "copy")
    left = contents(tmp_path)
    model = [] if verb == "train" else ["--model", run_folder / "model.onnx"]
    sentence = refused(verb, *model, "--data", tmp_path / "copy", "--out", tmp_path / "out")
    assert said in sentence
    assert str(tmp_path / "copy") in sentence
    assert contents(tmp_path) == left


def test_image_of_the_wrong_size_is_refused(
    refused: Refused, make_dataset: Callable[..., Path], run_folder: Path, tmp_path: Path
) -> None:
    smaller = make_dataset(tmp_path / "small", Camera(width=24, height=32))
    sentence = refused("evaluate", "--model", run_folder / "model.onnx", "--data", smaller)
    assert "another system than the network: camera camera: expected width 32, got 24" in sentence
    shipped = refused("evaluate", "--data", smaller)
    assert "camera camera: expected width 128, got 24" in shipped


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("study --out NEW --config PIPE", "PIPE: cannot be read (a device or a pipe); expected a study's"),
        ("study --out NEW --config DEEP", "DEEP: not the configuration of a study"),
        (
            "export --path PIPE --out NEW.npz",
            "PIPE: cannot be read (a device or a pipe); expected a simulated",
        ),
        ("estimate PIPE", "PIPE: cannot be read (a device or a pipe); expected a picture"),
        ("estimate PICTURE --model PIPE", "PIPE: cannot be read (a device or a pipe); expected an exported"),
        ("replay PIPE", "PIPE: cannot be read (a device or a pipe); expected a recording"),
        ("system show PIPE.toml", "PIPE.toml: cannot be read (a device or a pipe)"),
        ("control --out DEEP/x", "DEEP/x: cannot be made (Not a directory); name another folder"),
        ("evaluate --data DATA --model MODEL --out DEEP/x", "DEEP/x: cannot be made (Not a directory)"),
        ("replay", "expected FILE, got none; see exosight replay --help"),
        ("system", "expected {list,show,new,check}, got none; see exosight system --help"),
    ],
)
def test_pipes_nested_files_and_places_within_files_are_refused_in_a_sentence(
    refused: Refused, data: Path, run_folder: Path, tmp_path: Path, words: str, said: str
) -> None:
    """None of them waits for whoever writes to a pipe."""
    for name in ("pipe", "pipe.toml"):
        os.mkfifo(tmp_path / name)
    (tmp_path / "deep").write_text("[" * 100_000)
    places = {"PIPE": "pipe", "DEEP": "deep", "NEW": "new"}
    known = {"DATA": data, "MODEL": run_folder / "model.onnx", "PICTURE": "docs/images/camera.png"}
    for name, place in {**{k: tmp_path / v for k, v in places.items()}, **known}.items():
        words, said = words.replace(name, str(place)), said.replace(name, str(place))
    assert said in refused(*words.split())
    assert sorted(path.name for path in tmp_path.iterdir()) == ["deep", "pipe", "pipe.toml"]


def test_too_few_shapes_for_a_split_are_refused(
    refused: Refused, make_dataset: Callable[..., Path], tmp_path: Path
) -> None:
    few = make_dataset(tmp_path / "few", designs=PublishedDesigns().draw(1, 0)[:3])
    sentence = refused("train", "--data", few, "--out", tmp_path / "out")
    assert "expected at least 5 designs to divide, got 3" in sentence
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--protocol family", "split by family: name what is held out (linear, sine"),
        ("--protocol family --held-out square", "expected one of linear, sine, cosine_sum"),
        ("--held-out sine", "split by design: holds nothing out, got 'sine'"),
        (
            "--protocol variation --held-out plant.young",
            "expected none, as there is nothing to choose from, got",
        ),
        (
            "--protocol variation --held-out plant.young --online-designs 1",
            "--online-designs: expected 0 or more, and not",
        ),
    ],
)
def test_protocol_and_what_is_held_out_belong_together(
    refused: Refused, data: Path, tmp_path: Path, words: str, said: str
) -> None:
    assert said in refused("train", "--data", data, "--out", tmp_path / "out", *words.split())


# Networks


def test_a_network_is_judged_by_what_was_held_out_from_it(
    make_dataset: Callable[..., Path], tmp_path: Path
) -> None:
    data = make_dataset(tmp_path / "data", varies=("plant.young",))
    words = ["--protocol", "variation", "--held-out", "plant.young", "--epochs", "1", "--threads", "1"]
    main(["train", "--data", str(data), "--out", str(tmp_path / "run"), *words])
    loaded = load(data)
    card = OnnxEstimator.load(tmp_path / "run" / "model.onnx").card
    test, words = part_to_judge(card, loaded)
    young = loaded.variation["plant.young"]
    assert np.array_equal(test, np.flatnonzero(young >= np.quantile(young, 0.8)))
    assert words == "test part by variation (plant.young)"


def test_what_cannot_be_started_from_is_refused(
    refused: Refused, data: Path, run_folder: Path, tmp_path: Path, make_dataset: Callable[..., Path]
) -> None:
    """A network of another image size, a file that is none, one that knows what is to be judged by."""
    words = ("train", "--data", data, "--out", tmp_path / "out", "--threads", "1", "--pretrained")
    # The shipped network learned from seeds 0 to 3.
    for seed, said in (
        (7, "for another system: camera camera: expected width 128, got 32"),
        (0, "learned from designs of the same seed, 0"),
        (3, "learned from designs of the same seed, 3"),
    ):
        mine = make_dataset(tmp_path / f"seed_{seed}", seed=seed)
        sentence = refused("train", "--data", mine, "--out", tmp_path / "out", "--pretrained", "shipped")
        assert said in sentence
    assert "cannot be read" in refused(*words, tmp_path / "none.onnx")
    own = run_folder / "model.onnx"
    (tmp_path / "cut.onnx").write_bytes(own.read_bytes()[:-1000])
    assert "truncated or changed" in refused(*words, tmp_path / "cut.onnx")
    sentence = refused(*words, own, "--split-seed", "1")
    assert "learned from this dataset divided otherwise (by design, split seed 0)" in sentence
    sentence = refused(*words, own, "--protocol", "family", "--held-out", "sine")
    assert "learned from this dataset divided otherwise" in sentence
    assert not (tmp_path / "out").exists()


def test_a_network_goes_on_from_another_and_says_so(
    data: Path, run_folder: Path, tmp_path: Path, make_dataset: Callable[..., Path], refused: Refused
) -> None:
    own = run_folder / "model.onnx"
    words = ["--epochs", "1", "--threads", "1", "--pretrained", str(own)]
    other = make_dataset(tmp_path / "other", designs=PublishedDesigns().draw(1, 5), seed=2)
    wider = ["--extra-data", str(data)]
    main(["train", "--data", str(other), "--out", str(tmp_path / "wider"), *words, *wider])
    found = OnnxEstimator.load(tmp_path / "wider" / "model.onnx")
    assert found.card.training["pretrained"] == sealed(own.read_bytes())
    third = make_dataset(tmp_path / "third", designs=PublishedDesigns().draw(1, 6), seed=3)
    # A smaller draw of a seed has some of the same designs.
    fewer = make_dataset(tmp_path / "fewer", designs=PublishedDesigns().draw(1, 0)[:6])
    for judged, words in (
        (data, "all frames of a dataset that the network has learned from"),
        (third, "all frames of another dataset"),
        (
            fewer,
            "all frames of another dataset, of whose designs the network may have learned from some, as it "
            "did from seed 0",
        ),
    ):
        assert part_to_judge(found.card, load(judged))[1] == words
    # Of `data` it has learned from all frames, so it is no start for a network that is judged by them.
    again = ("train", "--data", data, "--out", tmp_path / "again", "--pretrained")
    sentence = refused(*again, tmp_path / "wider" / "model.onnx")
    assert "learned from the whole of this dataset" in sentence
    sentence = refused(
        *("train", "--data", other, "--out", tmp_path / "new", "--pretrained", own),
        *("--protocol", "family", "--held-out", "sine"),
    )
    assert "learned from the family sine" in sentence
    for start in (own, tmp_path / "wider" / "model.onnx"):
        sentence = refused("train", "--data", fewer, "--out", tmp_path / "new", "--pretrained", start)
        assert "learned from designs of the same seed, 0" in sentence


def test_files_that_are_no_network_are_refused(
    refused: Refused, data: Path, run_folder: Path, tmp_path: Path
) -> None:
    good = (run_folder / "model.onnx").read_bytes()
    wrong = {
        "text.onnx": b"not a network\n",
        "empty.onnx": b"",
        "cut.onnx": good[:-1000],
        "altered.onnx": good[:5000] + bytes([good[5000] ^ 1]) + good[5001:],
        "other.onnx": (run_folder / "checkpoint.safetensors").read_bytes(),
    }
    for name, content in wrong.items():
        (tmp_path / name).write_bytes(content)
    for path in (*(tmp_path / name for name in wrong), tmp_path / "missing.onnx", run_folder):
        for verb in ("evaluate --data DATA --model", "control --model"):
            sentence = refused(*verb.replace("DATA", str(data)).split(), path)
            assert sentence.startswith(f"{path}: ")
            assert "estimator" in sentence


def test_run_of_another_network_is_not_resumed(refused: Refused, data: Path, run_folder: Path) -> None:
    before = contents(run_folder)
    words = ["train", "--data", data, "--out", run_folder, "--resume", "--epochs", "1", "--threads", "1"]
    assert "the paper network needs 128×128 images" in refused(*words, "--network", "paper")
    assert "its recipe is modern, asked for is paper" in refused(*words, "--recipe", "paper")
    assert "its seed is 0, asked for is 1" in refused(*words, "--seed", "1")
    assert "its split_seed is 0, asked for is 1" in refused(*words, "--split-seed", "1")
    assert contents(run_folder) == before


def test_damaged_checkpoint_is_not_resumed(
    refused: Refused, data: Path, run_folder: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(run_folder, folder)
    os.truncate(folder / "checkpoint.safetensors", 5000)
    words = ["train", "--data", data, "--out", folder, "--resume", "--epochs", "1", "--threads", "1"]
    assert "checkpoint.safetensors: not a checkpoint of exosight, or damaged" in refused(*words)


def test_finished_run_is_returned_when_resumed(data: Path, run_folder: Path) -> None:
    before = contents(run_folder)
    main(
        [
            *("train", "--data", str(data), "--out", str(run_folder)),
            *("--resume", "--epochs", "1", "--threads", "1"),
        ]
    )
    assert contents(run_folder) == before


# Results


def test_evaluation_keeps_stdout_for_json_and_its_folder_for_everything(
    refused: Refused, data: Path, run_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["evaluate", "--model", str(run_folder / "model.onnx"), "--data", str(data)]
    out = tmp_path / "out"
    main([*words, "--out", str(out), "--seed", "3", "--json", "-"])
    shown = capsys.readouterr()
    answer = json.loads(shown.out)
    assert answer["frames"] == "8 frames: test part by design"
    assert len(answer["robustness"]) == len(answer["shifts"]) == 6
    assert len(answer["intervals"]) == 7 * 5
    # No clean picture of the plant is among the made-up ones: the held-out cases are not for them.
    assert [row["images"] for row in answer["ood"]] == list(OOD_KINDS)
    assert len(answer["baselines"]) == 4
    assert answer["baselines"][0]["RMSE exosight [N]"] == answer["robustness"][0]["RMSE exosight [N]"]
    assert "wrote" in shown.err
    config = json.loads((out / "config.json").read_text())
    assert (config["model"], config["data"], config["seed"]) == (words[2], words[4], 3)
    assert config["card"]["training"]["epochs"] == 1
    assert len((out / "forces.csv").read_text().splitlines()) == 1 + 8
    assert {"contacts.csv", "contacts.json", "robustness.csv", "evaluation.html"} <= {
        p.name for p in out.iterdir()
    }
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    before = contents(out)
    assert "exists already" in refused(*words, "--out", out)
    assert contents(out) == before


def test_another_dataset_is_judged_as_a_whole(
    make_dataset: Callable[..., Path],
    run_folder: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    other = make_dataset(tmp_path / "other", seed=1)
    main(
        [
            "evaluate",
            "--model",
            str(run_folder / "model.onnx"),
            "--data",
            str(other),
            "--json",
            str(tmp_path / "j"),
        ]
    )
    answer = json.loads((tmp_path / "j").read_text())
    assert answer["frames"] == "44 frames: all frames of another dataset"
    assert "baselines" not in answer  # it has no part that was learned from
    assert capsys.readouterr().out == ""


def test_simulation_answers_in_json(capsys: pytest.CaptureFixture[str]) -> None:
    words = "simulate --family linear --r0 0.01 --r1 0.005 --length 0.095 --u 2.4 -1 --json -"
    main(words.split())
    shown = capsys.readouterr()
    answer = json.loads(shown.out)
    assert shown.err == ""
    assert answer["exosuit"]["parameters"] == {"r0": 0.01, "r1": 0.005}
    assert [record["u"] for record in answer["path"]] == [2.4, -1]
    assert answer["path"][0]["F_net"] == pytest.approx(0.22, rel=0.02)  # what contact stiffness leaves open
    assert set(answer["units"]) == set(answer["path"][0]) - {"converged", "iterations"}


def test_simulation_shows_a_table_of_80_columns(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    main(["simulate", "--u", "-1.234", "0", "4"])
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    rows = [line.split() for line in lines if line.rstrip().split()[-2:-1] == ["yes"]]
    assert [row[0] for row in rows] == ["−1.234", "0", "4"]
    assert all(len(row) == 12 for row in rows)


# Ends


def test_full_disk_is_told_and_leaves_nothing(
    refused: Refused, data: Path, run_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    model = ["--model", run_folder / "model.onnx"]
    for words in (
        ["evaluate", *model, "--data", data, "--json", tmp_path / "scores.json"],
        ["evaluate", *model, "--data", data, "--out", tmp_path / "evaluation"],
        ["train", "--data", data, "--out", tmp_path / "run", "--epochs", "1"],
    ):
        with pytest.raises(SystemExit) as end:
            main([str(word) for word in words])
        assert end.value.code == 2
    assert contents(tmp_path) == {}


def test_full_disk_is_told_on_stdout_too() -> None:
    if not Path("/dev/full").exists():
        pytest.skip("needs a device that is always full")
    with open("/dev/full", "w") as full:
        done = started("--version", stdout=full)
    assert done.returncode == 2
    assert done.stderr.startswith("exosight: output: No space left on device; make room")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("words", [["--help"], ["simulate", "--help"]])
def test_reader_that_goes_away_is_no_error(words: list[str]) -> None:
    """As in `exosight --help | head -1`."""
    read, write = os.pipe()
    os.close(read)
    try:
        done = started(*words, stdout=write)
    finally:
        os.close(write)
    assert (done.returncode, done.stderr) == (0, "")


def test_terminal_without_unicode_is_served() -> None:
    done = started(
        *("simulate", "--help"), stdout=subprocess.PIPE, env={**os.environ, "PYTHONIOENCODING": "ascii"}
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "actuation [N]" in done.stdout


def stop_with(error: BaseException) -> Callable:
    def stop(*_: object, **__: object) -> None:
        raise error

    return stop


def test_ctrl_c_ends_quietly(
    data: Path,
    run_folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("exosight.app.evaluation.evaluate", stop_with(KeyboardInterrupt()))
    model = str(run_folder / "model.onnx")
    with pytest.raises(SystemExit) as end:
        main(["evaluate", "--model", model, "--data", str(data), "--out", str(tmp_path / "out")])
    assert end.value.code == 130
    assert capsys.readouterr().err == "exosight: stopped\n"
    assert list(tmp_path.iterdir()) == []


def test_bug_is_called_a_bug(
    data: Path, run_folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("exosight.app.evaluation.evaluate", stop_with(RuntimeError("boom")))
    words = ["evaluate", "--model", str(run_folder / "model.onnx"), "--data", str(data)]
    with pytest.raises(SystemExit) as end:
        main(words)
    assert end.value.code == 1
    shown = capsys.readouterr().err
    assert "a bug in exosight (RuntimeError: boom); please report it" in shown
    assert shown.count("\n") == 1
    monkeypatch.setenv("EXOSIGHT_TRACEBACK", "1")
    with pytest.raises(RuntimeError, match="boom"):
        main(words)


def test_too_little_memory_is_told(
    data: Path, run_folder: Path, refused: Refused, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("exosight.app.evaluation.evaluate", stop_with(MemoryError("for an array")))
    sentence = refused("evaluate", "--model", run_folder / "model.onnx", "--data", data)
    assert sentence.startswith("not enough memory (for an array)")

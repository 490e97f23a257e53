"""Pictures and readings of a system that nothing simulates, from `exosight import` to `live` and the lab."""

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from exosight.app import adaptation
from exosight.app.data import divided, load
from exosight.app.main import main
from exosight.app.pipeline import widened
from exosight.control.estimator import OnnxEstimator
from exosight.control.recording import read_recording
from exosight.dataset.export import export_dataset
from exosight.lab.uploads import estimate

SEQUENCES, EACH = 10, 16
CROP = ("--crop", "4", "2", "32", "32")
"""The part of the camera's 44×40 pixels that shows the blob."""


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A blob whose place is a pressure far from 0 and a force of either sign, its size another force."""
    folder = tmp_path_factory.mktemp("own") / "pictures"
    folder.mkdir()
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:32, :32] / 32
    with (folder / "readings.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["picture", "run", "line [kPa]", "thumb [N]", "grip [mN]"])
        for k in range(SEQUENCES * EACH):
            a, b, size = rng.uniform([0.25, 0.25, 0.5], [0.75, 0.75, 1.5])
            picture = 255 * np.exp(-((x - a) ** 2 + (y - b) ** 2) / (0.02 * size))
            whole = np.pad(picture.astype(np.uint8), ((2, 6), (4, 8)), constant_values=60)
            cv2.imwrite(str(folder / f"p_{k}.png"), whole)
            table.writerow([f"p_{k}.png", k // EACH, 100 + b, a - 0.5, 1000 * size])
    return folder


@pytest.fixture(scope="module")
def data(pictures: Path) -> Path:
    main(["import", str(pictures), "--out", str(pictures.parent / "data"), "--system", "blob", *CROP])
    return pictures.parent / "data"


@pytest.fixture(scope="module")
def model(data: Path) -> Path:
    words = [
        "--epochs",
        "25",
        "--batch",
        "16",
        "--recipe",
        "clean",
        "--threads",
        "1",
        "--precision",
        "float32",
    ]
    main(["train", "--data", str(data), "--out", str(data.parent / "run"), *words])
    return data.parent / "run" / "model.onnx"


def test_a_network_reads_every_channel_on_sequences_that_it_has_not_seen(
    data: Path, model: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["evaluate", "--data", str(data), "--model", str(model), "--json", "-"])
    found = json.loads(capsys.readouterr().out)
    assert found["frames"] == f"{2 * EACH} frames: test part by design"
    assert [row["sensor"] for row in found["sensors"]][:3] == ["line [Pa]", "thumb [N]", "grip [N]"]
    # 150 steps gave 0.997, 0.998 and 0.958; other processors round otherwise.
    assert min(row["r exosight"] for row in found["sensors"][:3]) > 0.9
    assert [row["estimator"] for row in found["baselines"]] == ["this network", "mean of training"]


def test_the_imported_part_is_remembered(
    data: Path, pictures: Path, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "the part 4 2 32 32" in (data / "README.md").read_text()
    whole = cv2.imread(str(pictures / "p_0.png"), cv2.IMREAD_GRAYSCALE)
    assert whole is not None
    cv2.imwrite(str(tmp_path / "part.png"), whole[2:34, 4:36])
    cv2.imwrite(str(tmp_path / "other.png"), whole[:36])  # of another camera
    given = ["--model", str(model), "--json", "-"]
    found = []
    for words in ([pictures / "p_0.png"], [tmp_path / "part.png"], [pictures / "p_0.png", *CROP[:-1]]):
        main(["estimate", *map(str, words), *given])
        found.append(json.loads(capsys.readouterr().out)["estimates"][0]["sensors"])
    assert found[0] == found[1] == found[2]
    with pytest.raises(SystemExit):
        main(["estimate", str(tmp_path / "other.png"), *given])
    assert "expected a square picture, got 44×36" in capsys.readouterr().err


def test_pictures_are_estimated_with_intervals_of_either_sign(
    pictures: Path, model: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["estimate", str(pictures / "p_3.png"), "--model", str(model), "--json", "-"])
    (found,) = json.loads(capsys.readouterr().out)["estimates"]
    keys = [tuple(row) for row in found["sensors"]]
    assert keys == [
        ("sensor", *(f"{word}_{u}" for word in ("value", "low", "high"))) for u in ("Pa", "N", "N")
    ]
    assert all(row["low_N"] < row["value_N"] < row["high_N"] for row in found["sensors"][1:])
    assert found["sensors"][0]["value_Pa"] == pytest.approx(100_500, abs=500)
    main(["estimate", str(pictures / "p_3.png"), "--model", str(model)])
    assert "contact" not in capsys.readouterr().out
    seen = estimate((pictures / "p_3.png").read_bytes(), OnnxEstimator.load(model))
    assert seen["reading"]["estimates"].keys() == {"thumb", "line", "grip"}
    assert "interval" not in seen["guard"]["cause"]  # of 100 Pa and more, which is no fault


def test_it_is_observed_and_replayed(
    pictures: Path, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["live", "--source", str(pictures), "--model", str(model), "--rate", "50", "--seconds", "0.5"]
    main([*words, "--record", str(tmp_path / "run.h5"), "--json", str(tmp_path / "run.json")])
    shown = capsys.readouterr().err
    assert "line 1e+05 (" in shown
    found = json.loads((tmp_path / "run.json").read_text())
    recorded = read_recording(tmp_path / "run.h5")
    assert found["sensors"] == {"thumb": "N", "line": "Pa", "grip": "N"}
    assert len(found["estimates"]) == len(recorded) == found["steps"]
    np.testing.assert_array_equal([row["value"] for row in found["estimates"]], recorded.estimated)
    assert not recorded.command.any()
    main(["replay", str(tmp_path / "run.h5"), "--model", str(model)])
    assert "the same estimates" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--source", "pictures", "--target", "0.2"], "--target is for a system that is simulated as well"),
        (["--source", "pictures", "--send", "-"], "--send is for a system that is simulated"),
        (["--source", "pictures", "--length", "0.1"], "--length is for a system that is simulated"),
        ([], "expected --source with pictures"),
    ],
)
def test_what_needs_a_simulation_is_refused(
    pictures: Path, model: Path, refused: Callable[..., str], words: list[str], sentence: str
) -> None:
    given = [str(pictures) if word == "pictures" else word for word in words]
    assert sentence in refused("live", "--model", model, *given)


def test_commands_without_a_simulation_are_one_sentence(
    data: Path, model: Path, tmp_path: Path, refused: Callable[..., str]
) -> None:
    assert "expected the sensors" in refused("evaluate", "--data", data)
    assert "another system" in refused("control", "--model", model, "--out", tmp_path / "control")
    assert "no configuration of exosight generate" in refused(
        "train", "--data", data, "--out", tmp_path / "run", "--online-designs", "1", "--epochs", "1"
    )


def test_a_second_import_leaves_out_what_the_first_keeps_for_testing(data: Path) -> None:
    own = load(data)
    split = divided(own, "design", 0, None)
    # The same recordings once more, in another order: known by their readings, not by their numbers.
    turned = {number: SEQUENCES - 1 - number for number in range(SEQUENCES)}
    designs = tuple(replace(d, number=turned[d.number]) for d in own.manifest.designs)
    frames = replace(own.frames, design=SEQUENCES - 1 - own.frames.design)
    other = replace(own, manifest=replace(own.manifest, designs=designs), frames=frames)
    wider, parts = widened(own, split, [other])
    assert len(wider) == len(own.frames) + len(split.train)
    added = wider.labels[parts.train[len(split.train) :]]
    np.testing.assert_array_equal(added, own.frames.labels[split.train])


@pytest.mark.parametrize("name", ["data.mat", "data.npz"])
def test_it_is_exported_as_any_other(data: Path, tmp_path: Path, name: str) -> None:
    assert export_dataset(data, tmp_path / name) == SEQUENCES * EACH


@pytest.fixture(scope="module")
def adapted(data: Path, model: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """To the same pictures in a mirror: the former network reads one coordinate the wrong way round."""
    folder = tmp_path_factory.mktemp("mirror") / "pictures"
    folder.mkdir()
    source = data.parent / "pictures"
    for path in source.glob("*.png"):
        picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        assert picture is not None
        cv2.imwrite(str(folder / path.name), np.ascontiguousarray(picture[:, ::-1]))
    (folder / "readings.csv").write_text((source / "readings.csv").read_text())
    out = folder.parent / "data"
    main(["import", str(folder), "--out", str(out), "--system", "mirror", "--crop", "8", "2", "32", "32"])
    words = [
        "--model",
        str(model),
        "--labels",
        "16",
        "--method",
        "affine",
        "--out",
        str(folder.parent / "run"),
    ]
    main(["adapt", "--data", str(folder.parent / "data"), *words])
    return folder.parent


def test_a_network_is_adapted_and_says_before_and_after(
    adapted: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = json.loads((adapted / "run" / "adaptation.json").read_text())
    assert (found["labels"], found["test_pictures"]) == (16, 2 * EACH)
    thumb = [next(s for s in found[when]["sensors"] if s["name"] == "thumb") for when in ("before", "after")]
    assert thumb[0]["r"] < -0.8 < 0.8 < thumb[1]["r"]
    place = str(adapted / "run" / "model.onnx")
    main(["evaluate", "--data", str(adapted / "data"), "--model", place, "--json", "-"])
    evaluated = json.loads(capsys.readouterr().out)
    assert evaluated["frames"] == f"{2 * EACH} frames: test part by design"  # the same ones
    row = next(row for row in evaluated["sensors"] if row["sensor"] == "thumb [N]")
    assert row["r exosight"] == pytest.approx(thumb[1]["r"], abs=1e-6)


def test_what_cannot_be_adapted_is_one_sentence(
    adapted: Path,
    data: Path,
    model: Path,
    tmp_path: Path,
    refused: Callable[..., str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    words = ["adapt", "--data", adapted / "data", "--out", tmp_path / "out"]
    assert "expected 0 to 128, the pictures that are not kept" in refused(
        *words, "--model", model, "--labels", "129"
    )
    monkeypatch.setattr(adaptation, "MOST", 20)
    assert "expected up to 20, got 21; exosight train --pretrained" in refused(
        *words, "--model", model, "--labels", "21"
    )
    assert "expected pictures of the network's size, 128×128 pixels, got 32×32" in refused(*words)
    assert "learned from this dataset divided otherwise" in refused(
        *("adapt", "--data", data, "--out", tmp_path / "out", "--model", model, "--split-seed", "1")
    )
    assert not (tmp_path / "out").exists()

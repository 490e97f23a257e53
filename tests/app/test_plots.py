"""`--plot`, `--poses` and what `simulate` says of its poses."""

import json
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import cv2
import numpy as np
import pytest

from exosight.app.main import main
from exosight.dataset import read_frames
from exosight.exosuit.shapes import FAMILIES

THUMB = Path(__file__).parents[2] / "examples" / "systems" / "thumb.toml"
Refused = Callable[..., str]
PLOTTING = ("simulate", "control", "live", "replay", "estimate", "evaluate", "system")


@pytest.mark.parametrize("ending", ["png", "pdf", "svg"])
def test_simulate_draws_its_readings_over_the_load(
    ending: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plot = tmp_path / f"path.{ending}"
    main(["simulate", "--u", "0", "1", "--plot", str(plot)])
    assert plot.stat().st_size > 5000
    if ending == "png":
        picture = cv2.imread(str(plot))
        assert picture is not None
        assert picture.std() > 10  # not an empty page


def test_simulate_draws_and_tells_the_force_along_tubes(tmp_path: Path) -> None:
    answer, plot = tmp_path / "path.json", tmp_path / "path.svg"
    words = ("--u", "2", "4", "--plot", str(plot), "--poses", "--json", str(answer))
    main(["simulate", "--system", str(THUMB), *words])
    assert plot.read_text().count('<g id="axes_') == 5  # contacts, their sum, angles; along both tubes
    found = json.loads(answer.read_text())
    assert found["units"]["force_per_length_skin"].startswith("x, y, z in N/m")
    for record in found["path"]:
        for name, zone in record["zones"].items():
            assert zone["magnitude"] == zone["normal"] == pytest.approx(record["readings"][name], abs=1e-12)
            assert zone["tangential"] == 0
        on, back = (np.array(record[f"force_per_length_{name}"]) for name in ("skin", "sleeve_tube"))
        # 20 parts of 38 + 30 mm and of 50 mm; the sleeve presses on nothing else.
        np.testing.assert_allclose(on.sum(axis=0) * 0.068, -back.sum(axis=0) * 0.05, atol=1e-12)
        assert np.linalg.norm(on.sum(axis=0) * 0.068 / 20) > 0.05


def test_estimate_draws_many_pictures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    image = cv2.imread(str(Path(__file__).parents[2] / "docs" / "images" / "camera.png"))
    assert image is not None
    names = [str(tmp_path / f"{i}.png") for i in range(3)]
    for name in names:
        cv2.imwrite(name, image)
    main(["estimate", *names, "--plot", str(tmp_path / "all.svg")])
    assert (tmp_path / "all.svg").read_text().count('<g id="axes_') == 8  # seven contacts and the score


@pytest.mark.parametrize("name", PLOTTING)
def test_where_a_plot_cannot_be_written_no_work_begins(name: str, tmp_path: Path, refused: Refused) -> None:
    assert "plot" in import_module(f"exosight.app.commands.{name}").__dict__[name].__annotations__
    needed = {
        "replay": ("none.h5",),
        "estimate": ("none.png",),
        "evaluate": ("--data", "none"),
        "system": ("show", "none"),
    }.get(name, ())
    (tmp_path / "there.png").write_text("precious")
    for plot, complaint in (
        ("a.txt", "expected a file *.png, *.pdf, *.svg"),
        ("there.png", "exists already"),
        ("nowhere/a.png", "is no folder"),
    ):
        assert complaint in refused(name, *needed, "--plot", tmp_path / plot)
    assert (tmp_path / "there.png").read_text() == "precious"


def test_poses_go_from_simulate_to_every_export(
    tmp_path: Path, refused: Refused, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["simulate", "--u", "0", "1.5", "--json", str(tmp_path / "plain.json")])
    main(["simulate", "--u", "0", "1.5", "--json", str(tmp_path / "path.json"), "--poses"])
    plain, found = (json.loads((tmp_path / name).read_text()) for name in ("plain.json", "path.json"))
    added = {"axis_exosuit", "radius_exosuit", "axis_finger", "radius_finger"}
    assert set(found["path"][0]) - set(plain["path"][0]) == added == set(found["units"]) - set(plain["units"])
    assert all(
        each[key] == value
        for each, own in zip(found["path"], plain["path"], strict=True)
        for key, value in own.items()
    )
    main(["export", "--path", str(tmp_path / "path.json"), "--out", str(tmp_path / "path.npz")])
    with np.load(tmp_path / "path.npz") as arrays:
        assert arrays["axis_exosuit"].shape == (2, 42, 3)
        assert arrays["radius_exosuit"].shape == (2, 42)
        np.testing.assert_array_equal(arrays["axis_exosuit"][:, -1, ::2], arrays["rod_tip"][:, :2])
        np.testing.assert_array_equal(arrays["axis_finger"][:, -1, ::2], arrays["finger_tip"])
        # The paper's exosuit: a taper from 5.8 mm to 4 mm over 0.1 m, which is straight without a load.
        np.testing.assert_allclose(arrays["radius_exosuit"][0][[0, -1]], [0.0058, 0.0040])
        ends = arrays["axis_exosuit"][0][[0, -1]]
        np.testing.assert_allclose(np.diff(ends[:, 0]), 0.1, atol=1e-3)  # its contact bends it a little
    main(["export", "--path", str(tmp_path / "path.json"), "--out", str(tmp_path / "path.csv")])
    assert "axis_exosuit_41_2" in (tmp_path / "path.csv").read_text()
    assert "--json" in refused("simulate", "--poses")
    assert "--data" in refused(
        "export", "--path", tmp_path / "path.json", "--out", tmp_path / "a.npz", "--poses"
    )


def test_poses_of_a_dataset_are_those_that_were_simulated(data: Path, tmp_path: Path) -> None:
    main(["export", "--data", str(data), "--out", str(tmp_path / "data.npz"), "--poses"])
    main(["export", "--data", str(data), "--out", str(tmp_path / "tables"), "--poses"])
    frames = read_frames(data)
    with np.load(tmp_path / "data.npz") as arrays:
        axis, radius = arrays["axis_exosuit"], arrays["radius_exosuit"]
        assert axis.shape == (len(frames), 42, 3)
        assert radius.shape == (len(frames), 42)
        # The base stays where it is mounted: above the finger's first node by both radii.
        lift = arrays["radius_finger"][:, 0] + radius[:, 0]
        np.testing.assert_allclose(axis[:, 0, 2], lift, atol=1e-6)
        tips = {tuple(tip) for tip in np.round(axis[:, -1], 6).tolist()}
        assert len(tips) > len(frames) / 2  # every frame its own
    rows = (tmp_path / "tables" / "pose_finger.csv").read_text().splitlines()
    assert rows[0] == "frame,node,x_m,y_m,z_m,radius_m"
    assert len(rows) == 1 + 5 * len(frames)


SHAPES = {
    "linear": ("--r0", "0.01", "--r1", "0.005"),
    "sine": ("--r0", "0.008", "--a", "-5"),
    "cosine_sum": ("--b", "-15", "-15", "-15", "-15", "-12", "-9", "-6"),
    "sine_cosine": ("--r0", "0.007", "--c", "1.5", "--d", "2.5", "--phi-c", "0.5", "--phi-d", "1"),
    "legendre": ("--m", "0.35", "0.1", "0.2", "0.3", "0.2", "0.1"),
}


@pytest.mark.parametrize("family", FAMILIES)
def test_a_rod_that_crosses_itself_is_said_to(family: str, capsys: pytest.CaptureFixture[str]) -> None:
    """At 2.4 N the thin exosuits of the cosine sum do: no rod feels itself."""
    main(["simulate", "--family", family, *SHAPES[family], "--length", "0.095", "--u", "0", "2.4"])
    told = " ".join(capsys.readouterr().err.split())
    said = "in 1 of 2 poses a rod crosses itself" in told and "choose a smaller command" in told
    assert said == (family == "cosine_sum")

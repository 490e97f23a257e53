"""`exosight export`: from a folder or a file to what other programs read."""

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import scipy.io

from exosight.app.main import main
from exosight.dataset import read_frames


def test_a_dataset_becomes_a_mat_file(data: Path, tmp_path: Path) -> None:
    main(["export", "--data", str(data), "--out", str(tmp_path / "data.mat")])
    found = scipy.io.loadmat(tmp_path / "data.mat")
    np.testing.assert_array_equal(found["sensors"], read_frames(data).sensors)


def test_a_dataset_becomes_a_folder(data: Path, tmp_path: Path) -> None:
    main(["export", "--data", str(data), "--out", str(tmp_path / "tables")])
    with (tmp_path / "tables" / "frames.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(read_frames(data))
    assert all((tmp_path / "tables" / row["image"]).is_file() for row in rows)
    assert [path.name for path in tmp_path.iterdir()] == ["tables"]


def test_a_simulated_path_becomes_a_table(tmp_path: Path) -> None:
    main(["simulate", "--u", "0", "1", "--json", str(tmp_path / "path.json")])
    main(["export", "--path", str(tmp_path / "path.json"), "--out", str(tmp_path / "path.csv")])
    with (tmp_path / "path.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["u"]) for row in rows] == [0.0, 1.0]
    assert all(row["converged"] == "True" for row in rows)


def test_wrong_use_is_refused(data: Path, tmp_path: Path, refused: Callable[..., str]) -> None:
    assert "one of --data, --path and --recording" in refused("export", "--out", tmp_path / "x.mat")
    assert "expected .mat" in refused("export", "--data", data, "--out", tmp_path / "x.xlsx")
    assert "expected .mat" in refused("export", "--path", data, "--out", tmp_path / "x")
    assert "no such folder" in refused("export", "--data", tmp_path / "none", "--out", tmp_path / "x.mat")
    (tmp_path / "there.mat").write_text("")
    assert "exists already" in refused("export", "--data", data, "--out", tmp_path / "there.mat")
    assert {path.name for path in tmp_path.iterdir()} == {"there.mat"}

"""A recording as MCAP, read back by the package's own import of ROS recordings."""

from pathlib import Path

import numpy as np
import pytest
from recorded_run import run

from exosight.control.mcap import export_recording
from exosight.control.paths import ControllerConfig
from exosight.control.recording import read_recording
from exosight.errors import DataError
from exosight.rig.bags import open_bags

pytest.importorskip("rosbags.rosbag2", reason="needs the extra 'ros'")


def test_a_recording_returns_from_mcap(tmp_path: Path, straight_config: ControllerConfig) -> None:
    run(tmp_path / "run.h5", straight_config)
    told = read_recording(tmp_path / "run.h5")
    export_recording(told, tmp_path / "run.mcap")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.h5", "run.mcap"]
    with open_bags([tmp_path / "run.mcap"], None, 1e-6) as (pictures, table):
        assert pictures.topic == "/camera/image"
        shown = np.flatnonzero(told.has_frame)
        assert len(pictures.names) == len(shown)
        images = list(told.images())
        for place, step in enumerate(shown):
            np.testing.assert_array_equal(pictures.picture(place), images[step])
        assert table is not None
        cells = {column.name: column.cells for column in table.columns}
    # Times are stored in nanoseconds, values as they are.
    np.testing.assert_allclose(pictures.times, told.time[shown] - told.time[0], rtol=0, atol=1e-9)
    for name, expected in (("command", told.command), ("true_C3", told.true[:, 2])):
        np.testing.assert_array_equal([float(cell) for cell in cells[name]], expected[shown])
    estimates = [float(cell) if cell else np.nan for cell in cells["estimated_C3"]]
    expected = np.where(told.has_estimate, told.estimated[:, 2], np.nan)[shown]
    np.testing.assert_array_equal(estimates, expected)
    with pytest.raises(DataError, match="exists already"):
        export_recording(told, tmp_path / "run.mcap")

"""`exosight replay`: the frames of a recorded run through network and guard once more."""

from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from exosight.app.commands.options import Json, MaybePath
from exosight.app.console import check_json_target, say, show, write_json


def replay(
    recording: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="FILE")]],
    model: MaybePath = None,
    json: Json = None,
) -> None:
    """Show a recorded run to network and guard once more, and compare.

    With the same network the same forces, states and actuations come out; with another one, what that would
    have read and asked for.

    Examples:
      exosight replay run.h5
      exosight replay run.h5 --model results/light/model.onnx

    Args:
        recording: file from exosight live --record
        model: exported network, from exosight train; the one that comes with the package if left out
        json: write every step as JSON to a new file, or to stdout with "-", instead of a table
    """
    check_json_target(json)
    from exosight.app.live import timing_table
    from exosight.control.estimator import DEFAULT_MODEL, OnnxEstimator
    from exosight.control.recording import STATES, checksum, read_recording
    from exosight.control.recording import replay as run

    place = model or DEFAULT_MODEL
    network = OnnxEstimator.load(place, alone=True)
    told = read_recording(recording)
    again = run(told, network.read)
    force = float(np.abs(again.forces - told.forces).max())
    u = float(np.abs(again.u - told.u).max())
    states = int(np.count_nonzero(again.state != told.state))
    same = checksum(place) == told.model
    if json is None:
        show(timing_table(told.seconds, told.late))
        for i in np.flatnonzero(told.cause != b""):
            say(f"{told.time[i]:7.1f} s  {STATES[told.state[i]].value}: {told.cause[i].decode()}")
    else:
        write_json(
            {
                "same_network": same,
                "steps": [
                    {
                        "time_s": float(told.time[i]),
                        "target_N": float(told.target[i]),
                        "forces_N": told.forces[i].tolist(),
                        "forces_replayed_N": again.forces[i].tolist(),
                        "u_N": float(told.u[i]),
                        "u_replayed_N": float(again.u[i]),
                        "state": STATES[told.state[i]].value,
                        "state_replayed": STATES[again.state[i]].value,
                    }
                    for i in range(len(told))
                ],
            },
            json,
        )
    whose = "the network of the recording" if same else "another network than the recording's"
    if force == u == states == 0:
        say(f"{len(told)} steps, {whose}: the same forces, states and actuations")
    else:
        say(
            f"{len(told)} steps, {whose}: forces differ by up to {force:.3g} N, u by up to {u:.3g} N, "
            f"the guard's state in {states} steps"
        )

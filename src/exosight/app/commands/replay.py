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

    With the same network the same estimates, states and commands come out; with another one, what that would
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
    config = told.controller
    network.card.check_fits(config.schema, "recording")
    again = run(told, network.read)
    outputs = float(np.abs(again.estimated - told.estimated).max())
    u = float(np.abs(again.command - told.command).max())
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
                "sensor": {"name": config.sensor, "unit": config.controlled.unit},
                "channel": {"name": config.channel, "unit": config.driven.unit},
                "outputs": {spec.name: spec.unit for spec in config.schema.estimated},
                "steps": [
                    {
                        "time_s": float(told.time[i]),
                        "target": float(told.target[i]),
                        "estimated": told.estimated[i].tolist(),
                        "estimated_replayed": again.estimated[i].tolist(),
                        "command": float(told.command[i]),
                        "command_replayed": float(again.command[i]),
                        "state": STATES[told.state[i]].value,
                        "state_replayed": STATES[again.state[i]].value,
                    }
                    for i in range(len(told))
                ],
            },
            json,
        )
    whose = "the network of the recording" if same else "another network than the recording's"
    if outputs == u == states == 0:
        say(f"{len(told)} steps, {whose}: the same estimates, states and commands")
    else:
        say(
            f"{len(told)} steps, {whose}: estimates differ by up to {outputs:.3g}, {config.channel} by up to "
            f"{u:.3g} {config.driven.unit}, "
            f"the guard's state in {states} steps"
        )

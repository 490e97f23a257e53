"""`exosight replay`: the frames of a recorded run through network and guard once more."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import tyro

from exosight.app.commands.options import Json, Paths, Plot
from exosight.app.console import check_json_target, say, show, write_json
from exosight.app.output import check_plot

if TYPE_CHECKING:
    from exosight.control.recording import Recording
    from exosight.control.replay import Replay


def replay(
    recording: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="FILE")]],
    model: Paths = (),
    plot: Plot = None,
    json: Json = None,
) -> None:
    """Run network and guard on the frames of a recorded run, and compare.

    With the same network the same estimates, states and commands come out; with another one, what that would
    have read and asked for.

    Examples:
      exosight replay run.h5
      exosight replay run.h5 --model results/light/model.onnx

    Args:
        recording: file from exosight live --record
        model: exported network, from exosight train; the package's own for the recorded system if left out;
            of several cameras one each, in the order of the run
        plot: draw sensor and command over time, recorded and replayed, to a new file (PNG, PDF or SVG)
        json: write every step as JSON to a new file, or to stdout with "-", instead of a table
    """
    check_json_target(json)
    check_plot(plot)
    from exosight.app.live import timing_table
    from exosight.app.observing import WORDS
    from exosight.control.estimator import model_path
    from exosight.control.recording import STATES, checksum, read_recording
    from exosight.control.replay import replay as run
    from exosight.control.views import check_fits, open_network

    recorded = read_recording(recording)
    config = recorded.controller
    places = [model_path(each, config.schema.system) for each in model or (None,)]
    network = open_network(places)
    check_fits(network, config.schema, "recording")
    again = run(recorded, network)
    outputs = float(np.abs(again.estimated - recorded.estimated).max())
    u = float(np.abs(again.command - recorded.command).max())
    states = int(np.count_nonzero(again.state != recorded.state))
    same = checksum(*places) == recorded.model
    if json is None:
        show(timing_table(recorded.seconds, recorded.late))
        for i in np.flatnonzero(recorded.cause != b""):
            state = STATES[recorded.state[i]]
            word = WORDS[state] if config.schema.measured else state.value
            say(f"{recorded.time[i]:7.1f} s  {word}: {recorded.cause[i].decode(errors='replace')}")
    else:
        write_json({"same_network": same, **_steps(recorded, again)}, json)
    if plot is not None:
        from exosight.app.plots import plot_replay, write_plot

        write_plot(plot_replay(recorded, again), plot)
    whose = "the network of the recording" if same else "another network than the recording's"
    if outputs == u == states == 0:
        say(f"{len(recorded)} steps, {whose}: the same estimates, states and commands")
    else:
        say(
            f"{len(recorded)} steps, {whose}: estimates differ by up to {outputs:.3g}, {config.channel} by "
            f"up to {u:.3g} {config.driven.unit}, the guard's state in {states} steps"
        )


def _steps(recorded: "Recording", again: "Replay") -> dict[str, Any]:
    """What was controlled, and each step as recorded and as replayed, as plain values."""
    from exosight.control.recording import STATES

    config = recorded.controller
    return {
        "sensor": {"name": config.sensor, "unit": config.controlled.unit},
        "channel": {"name": config.channel, "unit": config.driven.unit},
        "outputs": {spec.name: spec.unit for spec in config.schema.estimated},
        "steps": [
            {
                "time_s": float(recorded.time[i]),
                "target": float(recorded.target[i]),
                "estimated": recorded.estimated[i].tolist(),
                "estimated_replayed": again.estimated[i].tolist(),
                "command": float(recorded.command[i]),
                "command_replayed": float(again.command[i]),
                "state": STATES[recorded.state[i]].value,
                "state_replayed": STATES[again.state[i]].value,
            }
            for i in range(len(recorded))
        ],
    }

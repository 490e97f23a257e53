"""`exosight live`: the loop in real time, with a camera or a simulated exosuit."""

from typing import Annotated

import tyro
from pydantic import Field

from exosight.app.commands.options import Json, MaybePath
from exosight.app.console import check_json_target, say, show, write_json
from exosight.app.output import check_new_file
from exosight.errors import InputError

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Pixels = Annotated[
    tuple[int, int, int] | None, tyro.conf.arg(metavar="LEFT TOP WIDTH", help_behavior_hint="")
]


def live(
    source: Annotated[str | None, tyro.conf.arg(metavar="CAMERA|PATH", help_behavior_hint="")] = None,
    target: Annotated[float, Field(ge=0, le=50)] = 0.25,
    seconds: Annotated[float, Field(gt=0, le=1e6)] = 20.0,
    rate: Annotated[float, Field(gt=0, le=1000)] = 10.0,
    send: Annotated[str | None, tyro.conf.arg(metavar="PLACE|-", help_behavior_hint="")] = None,
    record: MaybePath = None,
    crop: Pixels = None,
    r0: float = 0.010,
    r1: float = 0.005,
    length: float = 0.095,
    young: float = 300e3,
    contact_limit: Positive = 0.5,
    max_rate: Positive = 10.0,
    model: MaybePath = None,
    json: Json = None,
) -> None:
    """Press with a force, in real time: see, estimate, decide, act.

    Without a source, a simulated exosuit is looked at and actuated. However the loop ends, Ctrl-C included,
    the actuation first returns to 0. At the start the controller is tuned on a simulation of the exosuit,
    which takes some seconds.

    Examples:
      exosight live
      exosight live --source 0 --target 0.3 --record run.h5
      exosight live --source 0 --send /dev/ttyUSB0

    Args:
        source: number of a camera, a folder of pictures or a video file
        target: F_net to press with [N]
        seconds: for how long [s]
        rate: steps a second [Hz]
        send: write u [N] there, one line a step: a serial device, a named pipe, a new file, or "-" for stdout
        record: new file (HDF5) for all that is seen, estimated and done; exosight replay reads it
        crop: part of the camera's picture that the network is shown [pixels]; default: the largest
        r0: radius of the exosuit at its base [m], 0.004…0.01
        r1: radius at its tip [m], 0.004…0.01
        length: its length [m], 0.07…0.11
        young: its Young's modulus [Pa], 1e3…1e9
        contact_limit: largest force on any one contact [N]
        max_rate: largest change of u a second [N/s]
        model: exported network, from exosight train; the one that comes with the package if left out
        json: write timing and the guard's log as JSON to a new file, or to stdout with "-"
    """
    check_json_target(json)
    if record is not None:
        check_new_file(record)
    if send == "-" and json == "-":
        raise InputError("live: expected u or JSON on stdout, got both; name a file for one of them")
    if send is not None and source is None:
        raise InputError("live: expected --source with --send; a simulated exosuit is actuated as it is")
    # Here, so that --help and wrong options answer at once: JAX takes a second to import.
    from exosight.app.live import Log, on_camera, on_simulation, timing_table
    from exosight.control.estimator import DEFAULT_MODEL
    from exosight.exosuit.assembly import Exosuit
    from exosight.exosuit.shapes import ExosuitShape, Linear

    exosuit = Exosuit(ExosuitShape(Linear(r0=r0, r1=r1), length=length), young=young)
    place, steps = model or DEFAULT_MODEL, max(1, round(seconds * rate))
    log = Log(say)
    say("tuning the controller on a simulation of the exosuit")
    limits = {"contact_limit": contact_limit, "rate": max_rate, "period": 1 / rate}
    try:
        if source is None:
            on_simulation(exosuit, limits, place, [target] * steps, record, log)
        else:
            on_camera(source, crop, send, exosuit, limits, place, [target] * steps, record, log)
    finally:
        if log.steps:
            say(f"u is back at 0 N after {log.steps} steps" + (f"; wrote {record}" if record else ""))
            if json is not None:
                write_json(log.summary(), json)
            elif send != "-":
                show(timing_table(log.seconds, log.late))

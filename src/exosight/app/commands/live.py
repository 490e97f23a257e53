"""`exosight live`: the loop in real time, with a camera or a simulated system."""

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import tyro
from pydantic import Field

from exosight.app.commands.options import Json, MaybePath, Name, SystemName
from exosight.app.console import check_json_target, say, show, write_json
from exosight.app.output import check_new_file
from exosight.errors import InputError

if TYPE_CHECKING:
    from exosight.exosuit.assembly import Exosuit

MaybePositive = Annotated[
    Annotated[float, Field(gt=0, allow_inf_nan=False)] | None, tyro.conf.arg(help_behavior_hint="")
]
Number = Annotated[float | None, tyro.conf.arg(help_behavior_hint="")]
Pixels = Annotated[
    tuple[int, int, int] | None, tyro.conf.arg(metavar="LEFT TOP WIDTH", help_behavior_hint="")
]


def live(
    source: Annotated[str | None, tyro.conf.arg(metavar="CAMERA|PATH", help_behavior_hint="")] = None,
    target: Annotated[
        Annotated[float, Field(ge=0, le=50)] | None, tyro.conf.arg(help_behavior_hint="")
    ] = None,
    seconds: Annotated[float, Field(gt=0, le=1e6)] = 20.0,
    rate: Annotated[float, Field(gt=0, le=1000)] = 10.0,
    send: Annotated[str | None, tyro.conf.arg(metavar="PLACE|-", help_behavior_hint="")] = None,
    record: MaybePath = None,
    crop: Pixels = None,
    system: SystemName = "published",
    sensor: Name = None,
    channel: Name = None,
    r0: Number = None,
    r1: Number = None,
    length: Number = None,
    young: Number = None,
    contact_limit: MaybePositive = None,
    max_rate: MaybePositive = None,
    model: MaybePath = None,
    json: Json = None,
) -> None:
    """Press with a force, in real time: acquire, estimate, control, actuate.

    Without a source, a simulated system is looked at and actuated. However the loop ends, Ctrl-C included,
    the command first returns to 0. At the start the controller is tuned on a simulation of the system,
    which takes some seconds.

    Examples:
      exosight live
      exosight live --source 0 --target 0.3 --record run.h5
      exosight live --source 0 --send /dev/ttyUSB0
      exosight live --system thumb.toml --model results/thumb/model.onnx

    Args:
        source: number of a camera, a folder of pictures or a video file
        target: of the controlled sensor [its unit]; default: half of its largest reading within the limits
        seconds: for how long [s]
        rate: steps a second [Hz]
        send: write the command there, one line a step: a serial device, a named pipe, a new file, or "-" for
            stdout
        record: new file (HDF5) for all that is seen, estimated and done; exosight replay reads it
        crop: part of the camera's picture that the network is shown [pixels]; default: the largest
        system: name of a preset, or a system file (*.toml)
        sensor: the one that follows the target; default: the first net force
        channel: the one that is driven; default: the first
        r0: of the published system: radius of the exosuit at its base [m], 0.004…0.01; default: 0.01
        r1: of the published system: radius at its tip [m], 0.004…0.01; default: 0.005
        length: of the published system: length of the exosuit [m], 0.07…0.11; default: 0.095
        young: of the published system: its Young's modulus [Pa], 1e3…1e9; default: 3e5
        contact_limit: largest force on any one contact [N]; default: the sensors' own, or 0.5
        max_rate: largest change of the command a second [its unit/s]; default: the channel's own, or its peak
            in 0.4 s
        model: exported network, from exosight train; the one that comes with the package if left out
        json: write timing and the guard's log as JSON to a new file, or to stdout with "-"
    """
    check_json_target(json)
    if record is not None:
        check_new_file(record)
    if send == "-" and json == "-":
        raise InputError(
            "live: expected the command or JSON on stdout, got both; name a file for one of them"
        )
    if send is not None and source is None:
        raise InputError("live: expected --source with --send; a simulated system is actuated as it is")
    # Here, so that --help and wrong options answer at once: JAX takes a second to import.
    from exosight.app.live import LiveRun, Log, on_camera, on_simulation, timing_table
    from exosight.app.nominal import nominal_system
    from exosight.control.estimator import DEFAULT_MODEL, OnnxEstimator
    from exosight.control.tuning import tune
    from exosight.exosuit.catalogue import find_system
    from exosight.exosuit.published import PublishedDesigns

    designs = find_system(system)
    given = {"r0": r0, "r1": r1, "length": length, "young": young}
    named = [name for name, value in given.items() if value is not None]
    if named and not isinstance(designs, PublishedDesigns):
        raise InputError(f"--{named[0]}: of the published system alone; change {system} instead")
    network = OnnxEstimator.load(model or DEFAULT_MODEL, alone=True)
    driven = nominal_system(designs, _exosuit(r0, r1, length, young), network)
    say("tuning the controller on a simulation of the system")
    config = tune(driven, sensor, channel, contact_limit=contact_limit, rate=max_rate, period=1 / rate)
    target = config.default_target if target is None else target
    if target > (largest := float(config.loading.controlled[-1])):
        unit = config.controlled.unit
        say(f"{config.sensor} reads at most {largest:.3f} {unit} within the limits, less than the target")
    steps, log = max(1, round(seconds * rate)), Log(say, config)
    run = LiveRun(driven, network, model or DEFAULT_MODEL, config, [target] * steps, record)
    try:
        if source is None:
            on_simulation(run, log)
        else:
            on_camera(run, source, crop, send, log)
    finally:
        if log.steps:
            rest = f"{config.channel} is back at 0 {config.driven.unit}"
            say(f"{rest} after {log.steps} steps" + (f"; wrote {record}" if record else ""))
            if json is not None:
                write_json(log.summary(), json)
            elif send != "-":
                show(timing_table(log.seconds, log.late))


def _exosuit(r0: float | None, r1: float | None, length: float | None, young: float | None) -> "Exosuit":
    """The exosuit of the published system: that of the paper's controller but for what is given."""
    from exosight.control import CONTROL_SHAPE
    from exosight.exosuit.assembly import Exosuit
    from exosight.exosuit.shapes import Linear

    surface = CONTROL_SHAPE.surface
    assert isinstance(surface, Linear)
    surface = Linear(r0=surface.r0 if r0 is None else r0, r1=surface.r1 if r1 is None else r1)
    shape = replace(CONTROL_SHAPE, surface=surface, length=CONTROL_SHAPE.length if length is None else length)
    return Exosuit(shape) if young is None else Exosuit(shape, young=young)

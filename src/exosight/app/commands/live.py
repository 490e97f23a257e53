"""`exosight live`: the loop in real time, with a camera or a simulated system."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

from exosight.app.commands.options import (
    NO_OPTIONS,
    NOMINAL_LOOP,
    ExosuitOptions,
    Json,
    LoopOptions,
    MaybePath,
    Paths,
    Pixels,
    Plot,
)
from exosight.app.console import check_json_target, say, show, write_json
from exosight.app.output import check_new_file, check_plot
from exosight.control.actuators import UDP, serial_place
from exosight.control.guarded import GuardedName
from exosight.errors import InputError

if TYPE_CHECKING:
    from exosight.control.estimator import OnnxEstimator
    from exosight.control.views import Views

MaybePositive = Annotated[
    Annotated[float, Field(gt=0, allow_inf_nan=False)] | None, tyro.conf.arg(help_behavior_hint="")
]


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class DeviceOptions:
    """Camera and actuator."""

    source: Annotated[tuple[str, ...], tyro.conf.arg(metavar="CAMERA|PATH", help_behavior_hint="")] = ()
    """number of a camera, a folder of pictures or a video file; several, one for each network of --model"""
    crop: Pixels = None
    """part of each picture that the network gets [pixels]; default: of the camera that it learned from the
    part that was imported; else the largest in the middle of a camera's or video's, all of a picture file"""
    send: Annotated[str | None, tyro.conf.arg(metavar="PLACE|-", help_behavior_hint="")] = None
    """write the command there, one line a step, "17 u 2.3750 N": a serial device (/dev/ttyUSB0, or @ and its
    speed behind), udp://HOST:PORT, a named pipe, a new file, or "-" for stdout"""
    actuator: Annotated[Path | None, tyro.conf.arg(metavar="CSV", help_behavior_hint="")] = None
    """calibration of the actuator: a table with a column of its commands, such as "pressure [kPa]", and one
    of the loads that they make, "u [N]"; lines are then in its unit, and loads within its range"""


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class RunOptions:
    """Target, duration, rate and limits."""

    target: Annotated[Annotated[float, Field(ge=0, le=50)] | None, tyro.conf.arg(help_behavior_hint="")] = (
        None
    )
    """of the controlled sensor [its unit]; default: half of its largest reading within the limits"""
    seconds: Annotated[float, Field(gt=0, le=1e6)] = 20.0
    """for how long [s]"""
    rate: Annotated[float, Field(gt=0, le=1000)] = 10.0
    """steps a second [Hz]"""
    controller: GuardedName = "guarded"
    """the scheduled law behind its guard; or the adaptive one, for systems without jumps, such as index"""
    contact_limit: MaybePositive = None
    """largest force on any one contact [N]; default: the sensors' own, or 0.5"""
    max_rate: MaybePositive = None
    """largest change of the command a second [its unit/s]; default: the channel's own, or its peak in
    0.4 s"""
    record: MaybePath = None
    """new file (HDF5) for all that is seen, estimated and done; exosight replay reads it"""


SIMULATED, NOMINAL_RUN = DeviceOptions(), RunOptions()


def live(
    device: Annotated[DeviceOptions, tyro.conf.arg(name="")] = SIMULATED,
    run: Annotated[RunOptions, tyro.conf.arg(name="")] = NOMINAL_RUN,
    loop: Annotated[LoopOptions, tyro.conf.arg(name="")] = NOMINAL_LOOP,
    exosuit: Annotated[ExosuitOptions, tyro.conf.arg(name="")] = NO_OPTIONS,
    model: Paths = (),
    plot: Plot = None,
    json: Json = None,
) -> None:
    """Control a force in real time: image, estimate, control law, actuator.

    With a network for a system that was only measured (exosight import), nothing is driven: pictures are
    read, judged and recorded. Otherwise, without a source, the system is simulated. However the loop ends,
    Ctrl-C included, the command first returns to 0. At the start the controller is tuned on a simulation of
    the system, which takes some seconds. A preset has the exosuit of the paper's controller (r0 0.01,
    r1 0.005, length 0.095) unless options say otherwise.

    Examples:
      exosight live
      exosight live --source 0 --target 0.3 --record run.h5
      exosight live --source 0 --send /dev/ttyUSB0 --actuator valve.csv
      exosight live --source 0 --send /dev/ttyUSB0@9600
      exosight live --system index --controller adaptive --model index-control
      exosight live --system thumb.toml --model results/thumb/model.onnx
      exosight live --source 0 --model results/rig/model.onnx --record run.h5
      exosight live --source 0 1 --system rig.toml --model side.onnx top.onnx

    Args:
        device: camera and actuator
        run: target, duration, rate and limits
        loop: what is driven
        exosuit: of a preset
        model: exported network, from exosight train; the package's own for the system if left out.
            Several are of one camera each, in the order of --source, and read as one (docs/realtime.md)
        plot: draw the sensor and the command over time, to a new file (PNG, PDF or SVG)
        json: write timing and the guard's log as JSON to a new file, or to stdout with "-"
    """
    check_json_target(json)
    check_plot(plot)
    if run.record is not None:
        check_new_file(run.record)
    if device.send is not None and device.send != "-" and not device.send.startswith(UDP):
        sink, _ = serial_place(device.send)
        if sink.is_file() or not sink.exists():  # neither a device nor a pipe
            check_new_file(sink)
    if device.send == "-" and json == "-":
        raise InputError(
            "live: expected the command or JSON on stdout, got both; name a file for one of them"
        )
    if not device.source and (device.send is not None or device.crop is not None):
        given = "--send" if device.crop is None else "--crop"
        raise InputError(f"live: expected --source with {given}; a simulated system is used as it is")
    if device.actuator is not None and device.send is None:
        raise InputError("live: expected --send with --actuator, which says in what unit commands are sent")
    # Here, so that --help and wrong options answer at once: JAX takes a second to import.
    from exosight.app.live import LiveRun, Log, on_simulation, on_source, opened, timing_table
    from exosight.app.nominal import nominal_system
    from exosight.app.observing import refuse_control
    from exosight.app.plots import plot_run, write_plot
    from exosight.control import CONTROL_SHAPE
    from exosight.control.actuator_curve import read_actuator_curve, within_curve
    from exosight.control.estimator import model_path
    from exosight.control.tuning import tune
    from exosight.control.views import cameras_of, open_network
    from exosight.exosuit.catalogue import find_system
    from exosight.system.designs import FileDesigns

    places = tuple(model_path(each, loop.system) for each in model or (None,))
    network = open_network(places)
    if cameras_of(network)[0].card.schema.measured:
        network = open_network(places, alone=True)  # no commands are known of what is not driven
        own, own_run = NOMINAL_LOOP, NOMINAL_RUN
        changed = {
            "system": loop.system != own.system, "sensor": loop.sensor, "channel": loop.channel,
            "target": run.target, "contact-limit": run.contact_limit, "max-rate": run.max_rate,
            "controller": run.controller != own_run.controller,
            "send": device.send, "actuator": device.actuator,
            **{name.replace("_", "-"): True for name in exosuit.given()},
        }  # fmt: skip
        refuse_control(cameras_of(network)[0].card.schema.system, changed)
        _observe(device, run, network, places, plot, json)
        return
    designs = find_system(loop.system)
    if isinstance(designs, FileDesigns):
        exosuit.refuse(f"change {loop.system} instead")
    system = nominal_system(designs, exosuit.exosuit(CONTROL_SHAPE, loop.system), network)
    curve = None
    if device.actuator is not None:
        channel = system.schema.channel(loop.channel)
        curve = read_actuator_curve(device.actuator, channel)
        system = within_curve(system, channel.name, curve)
    with opened(device.source, network, device.crop, 1 / run.rate) as frames:
        say("tuning the controller on a simulation of the system")
        limits = {"contact_limit": run.contact_limit, "rate": run.max_rate}
        config = tune(system, loop.sensor, loop.channel, period=1 / run.rate, **limits)
        target = config.default_target if run.target is None else run.target
        if target > (largest := float(config.loading.controlled[-1])):
            unit = config.controlled.unit
            say(f"{config.sensor} reads at most {largest:.3f} {unit} within the limits, less than the target")
        targets, log = [target] * max(1, round(run.seconds * run.rate)), Log(say, config)
        started = LiveRun(system, network, places, config, targets, run.record, run.controller)
        try:
            if frames is None:
                on_simulation(started, log)
            else:
                on_source(started, frames, device.send, log, curve)
        finally:
            if log.steps:
                say(log.end() + (f"; wrote {run.record}" if run.record and run.record.exists() else ""))
                if plot is not None:
                    write_plot(plot_run(config, log.run()), plot)
                if json is not None:
                    write_json(log.summary(), json)
                elif device.send != "-":
                    show(timing_table(log.seconds, log.late))


def _observe(
    device: DeviceOptions,
    run: RunOptions,
    network: "OnnxEstimator | Views",
    places: tuple[Path, ...],
    plot: Path | None,
    json: str | None,
) -> None:
    """Read, judge and record the pictures of a source."""
    from exosight.app.live import LiveRun, opened, timing_table
    from exosight.app.observing import ObservationLog, observe
    from exosight.app.plots import plot_estimates, write_plot
    from exosight.control.at_rest import at_rest
    from exosight.control.views import cameras_of

    schema = cameras_of(network)[0].card.schema
    with opened(device.source, network, device.crop, 1 / run.rate) as frames:
        if frames is None:
            raise InputError(
                f"live: expected --source with pictures, as of {schema.system} no simulation is known"
            )
        config = at_rest(schema, 1 / run.rate)
        log = ObservationLog(say, config)
        still = [0.0] * max(1, round(run.seconds * run.rate))
        try:
            observe(LiveRun(None, network, places, config, still, run.record), frames, log)
        finally:
            if log.steps:
                say(log.end() + (f"; wrote {run.record}" if run.record and run.record.exists() else ""))
                if plot is not None and log.readings:
                    write_plot(plot_estimates(schema, log.readings), plot)
                if json is not None:
                    write_json(log.summary(), json)
                else:
                    show(timing_table(log.seconds, log.late))

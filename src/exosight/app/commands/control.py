"""`exosight control`: the closed loop, with a network or the true reading as its sensor."""

from typing import Annotated, Literal

import tyro
from pydantic import Field

from exosight.app.commands.options import NOMINAL_LOOP, Json, LoopOptions, MaybePath, Plot
from exosight.app.console import check_json_target, results_folder, show_or_write
from exosight.app.output import check_plot
from exosight.control.guarded import GuardedName
from exosight.errors import InputError

Target = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Late = Annotated[float, Field(ge=0, le=2)]


def control(
    loop: Annotated[LoopOptions, tyro.conf.arg(name="")] = NOMINAL_LOOP,
    targets: tuple[Target, ...] = (),
    gains: tuple[Target, ...] = (),
    controller: Literal["proportional", GuardedName] = "proportional",
    lag: Late = 0.0,
    dead_time: Late = 0.0,
    law: MaybePath = None,
    model: MaybePath = None,
    out: MaybePath = None,
    plot: Plot = None,
    json: Json = None,
) -> None:
    """Close the loop on a simulated system, with the paper's law or another controller.

    The published system goes through the paper's six trials: constant targets 0.25, 0.30, 0.35 N with
    K_P = 5; and 0.2 N for 10 s, then 0 N, with K_P = 0.1, 1 and 100. With another system, or any of the
    options sensor, channel, targets and gains, each target is held for 10 s and then released, with each
    gain. A controller that is guarded or adaptive has no gain: it is tuned on a simulation of the system and
    goes through each of these targets once. What is measured is the network's estimate from the camera image;
    without a network it is the true reading.

    Examples:
      exosight control --model results/light/model.onnx --out results/control
      exosight control --system examples/systems/thumb.toml --targets 0.2 0.3
      exosight control --system index --controller adaptive --model index-control
      exosight control --system index --law index-policy

    Args:
        loop: what is driven
        targets: of the sensor [its unit]; default: half of its largest reading within the limits
        gains: K_P [channel's unit per sensor's]; default: half of what the steepest part of the path asks for
        controller: the paper's proportional law; the scheduled law behind its guard; or the adaptive one
        lag: of the actuators [s]: time in which they go 63 % of the way to a command
        dead_time: of the actuators [s]: time before anything of a command arrives
        law: a learned policy, which corrects the command of the adaptive controller: a file, or
            'index-policy', the package's own for index
        model: exported network, from `exosight train`, or 'shipped', the package's own for the system;
            without it the sensor is the true reading
        out: folder for time series (CSV), figures (SVG), results and configuration (JSON); it must not exist
        plot: draw sensor and command of every trial over time, to a new file (PNG, PDF or SVG)
        json: write the results as JSON to a new file, or to stdout with "-", instead of a table
    """
    check_json_target(json)
    check_plot(plot)
    if law is not None and controller == "guarded":
        raise InputError(
            "control: expected the adaptive controller with --law, got guarded; leave --controller out"
        )
    controller = controller if law is None else "adaptive"
    if gains and controller != "proportional":
        raise InputError(
            f"control: expected --gains with the proportional law alone, got {controller}; leave them out"
        )
    # Here, so that --help and wrong options answer at once: JAX and Matplotlib take seconds to import.
    from exosight.app.control_command import (
        held_and_released,
        run_guarded_with_progress,
        run_with_progress,
        summaries,
        trials_table,
        write_trials,
    )
    from exosight.app.nominal import nominal_system
    from exosight.app.plots import plot_trials, write_plot
    from exosight.control import (
        CONTROL_SHAPE,
        OnnxEstimator,
        from_image,
        measurement_from,
        published_trials,
        true_measurement,
        true_reading,
    )
    from exosight.control.estimator import model_name, model_path
    from exosight.control.policy_file import LearnedPolicy, policy_path
    from exosight.control.valve import Valve
    from exosight.exosuit.assembly import Exosuit
    from exosight.exosuit.catalogue import find_system
    from exosight.exosuit.published import PublishedDesigns

    designs = find_system(loop.system)
    place = None if model is None else model_path(model, loop.system)
    proportional = controller == "proportional"
    policy = None if law is None else LearnedPolicy.load(policy_path(law))
    valve = Valve(lag, dead_time)
    estimator = None if place is None else OnnxEstimator.load(place, history=proportional)
    driven = nominal_system(designs, Exosuit(CONTROL_SHAPE), estimator)
    if isinstance(designs, PublishedDesigns) and not (loop.sensor or loop.channel or targets or gains):
        asked = published_trials()
    else:
        asked = held_and_released(driven, loop.sensor, loop.channel, targets, gains)
    with results_folder(out) as folder:
        if proportional:
            measure = true_reading(loop.sensor)
            if estimator is not None:
                measure = from_image(estimator, driven.schema, loop.sensor)
            trials = run_with_progress(driven, measure, asked, loop.sensor, loop.channel, valve)
        else:
            sense = true_measurement if estimator is None else measurement_from(estimator)
            trials = run_guarded_with_progress(
                driven, policy or controller, sense, asked, loop.sensor, loop.channel, valve
            )
        if folder is not None:
            name = controller if law is None else model_name(policy_path(law))
            write_trials(trials, place and model_name(place), driven.camera, folder, name)
    if plot is not None:
        write_plot(plot_trials(trials), plot)
    show_or_write([trials_table(trials)], {"trials": summaries(trials)}, json)

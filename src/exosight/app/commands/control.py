"""`exosight control`: the closed loop, with a network or the true force as its sensor."""

from contextlib import nullcontext

from exosight.app.commands.options import Json, MaybePath
from exosight.app.console import check_json_target, say, show, write_json
from exosight.app.output import new_folder


def control(model: MaybePath = None, out: MaybePath = None, json: Json = None) -> None:
    """Run the paper's six closed-loop trials on a simulated exosuit.

    Constant targets 0.25, 0.30, 0.35 N with K_P = 5; and 0.2 N for 10 s, then 0 N, with K_P = 0.1, 1 and 100.
    The sensor is a network that sees the camera image; without one it is the true force.

    Example:
      exosight control --model results/light/model.onnx --out results/control

    Args:
        model: exported network, from `exosight train`; without it the sensor is the true force
        out: folder for time series (CSV), figures (SVG), results and configuration (JSON); it must not exist
        json: write the results as JSON to a new file, or to stdout with "-", instead of a table
    """
    check_json_target(json)
    # Here, so that --help and wrong options answer at once: JAX and Matplotlib take seconds to import.
    from exosight.app.control_command import run_trials, summaries, trials_table, write_trials
    from exosight.app.pipeline import camera_of
    from exosight.control import CONTROL_SHAPE, OnnxEstimator, from_image, true_force
    from exosight.exosuit.assembly import Exosuit
    from exosight.system.camera import Camera

    with new_folder(out) if out is not None else nullcontext() as folder:
        camera, measure = Camera(), true_force
        if model is not None:
            estimator = OnnxEstimator.load(model)
            camera, measure = camera_of(estimator.card), from_image(estimator)
        trials = run_trials(Exosuit(CONTROL_SHAPE), camera, measure)
        if folder is not None:
            write_trials(trials, model and str(model), camera, folder)
    if out is not None:
        say(f"wrote {out}")
    if json is None:
        show(trials_table(trials))
    else:
        write_json({"trials": summaries(trials)}, json)

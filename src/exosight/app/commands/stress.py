"""`exosight stress`: the controllers in random episodes with disturbances."""

from typing import Annotated

import tyro
from pydantic import Field

from exosight.app.commands.options import NOMINAL_LOOP, Json, LoopOptions, MaybePath, Seed
from exosight.app.console import check_json_target, results_folder, show_or_write
from exosight.control.stress import ControllerName, StressConfig
from exosight.errors import InputError

DEFAULT = StressConfig()

Gain = Annotated[float, Field(gt=0, le=1e4)]
Gains = Annotated[tuple[Gain, ...] | None, tyro.conf.arg(metavar="K_P …", help_behavior_hint="")]


def stress(
    config: Annotated[StressConfig, tyro.conf.arg(name="")] = DEFAULT,
    episodes: Annotated[int, Field(ge=1, le=100_000)] = 1000,
    seed: Seed = 0,
    controllers: Annotated[tuple[ControllerName, ...], tyro.conf.arg(metavar="NAME …")] = ("guarded",),
    gains: Gains = None,
    loop: Annotated[LoopOptions, tyro.conf.arg(name="")] = NOMINAL_LOOP,
    law: MaybePath = None,
    model: MaybePath = None,
    causes: Annotated[int, Field(ge=0, le=1000)] = 0,
    save_worst: Annotated[int, Field(ge=0, le=1000)] = 0,
    out: MaybePath = None,
    json: Json = None,
) -> None:
    """Run controllers and the paper's law in random episodes, all stepped side by side.

    In each episode a target is followed and then drops to 0; frames come late, twice, degraded or not at all,
    system and camera are not those that were tuned for, and the user moves. The sensor is a network
    that sees camera images; without one it is the true reading.

    Examples:
      exosight stress --episodes 100
      exosight stress --system index --controllers oracle adaptive --gains
      exosight stress --suite 2 --system index --controllers oracle adaptive
      exosight stress --system index --controllers adaptive learned --gains
      exosight stress --model results/light/model.onnx --out results/stress
      exosight stress --latency 0.1 0.1 --dropped 0.1 0.1 --no-wrong-plant

    Args:
        config: what may go wrong
        episodes: how many
        seed: seed of all that is drawn
        controllers: guarded: the scheduled law behind its guard; adaptive: observer, law and authority in
            one; learned: the same with a learned correction of its command; unguarded: this with full
            authority whatever it knows; oracle: the bound, which feels the true force at once and knows plant
            and user; delayed-oracle: the same with the user as he was when the last usable frame was taken
        gains: K_P of the paper's law [channel's unit per sensor's], one run each; none: only the
            controllers above; default: 5, the paper's, for F_net of the presets, otherwise half of
            what the steepest part of the path asks for
        law: policy of the learned controller; default: 'index-policy', the package's own for index
        loop: what is driven; the `vary` tables of a system file are what may be wrong about it
        model: exported network, from `exosight train`, 'shipped', the package's own for the system, or
            'index-control', its own for closed loops;
            without it the sensor is the true reading
        causes: failed episodes of each controller that are run again, once for each disturbance without it;
            needs the oracle
        save_worst: episodes of the guarded and the adaptive controller, the worst first, that are written
            to --out as recordings for exosight replay; needs a model
        out: folder for summary (JSON), every episode (CSV) and figure (SVG); it must not exist
        json: write the summary as JSON to a new file, or to stdout with "-", instead of a table
    """
    check_json_target(json)
    if causes and "oracle" not in controllers:
        raise InputError("causes: expected the oracle among the controllers, which tells what is attainable")
    if save_worst and (model is None or out is None):
        raise InputError("save-worst: expected --model, as recordings hold pictures, and a folder --out")
    # Here, so that --help and wrong options answer at once: JAX and Matplotlib take seconds to import.
    from exosight.app import stress as run
    from exosight.control.estimator import model_path
    from exosight.control.policy_file import LearnedPolicy, policy_path
    from exosight.exosuit.catalogue import find_system

    model = None if model is None else model_path(model, loop.system)
    learned = any(name in ("learned", "unguarded") for name in controllers)
    if law is not None and not learned:
        raise InputError("stress: expected the controller learned or unguarded with --law, got neither")
    law = policy_path(law) if learned else None
    policy = None if law is None else LearnedPolicy.load(law)
    plants, look = run.prepare(find_system(loop.system), model, loop.sensor, loop.channel)
    gains = (plants.gain,) if gains is None else gains
    with results_folder(out) as folder:
        outcomes = run.run_stress(config, episodes, seed, controllers, gains, plants, look, causes, policy)
        found = run.results(outcomes, run.about(config, episodes, seed, gains, model, plants, law))
        if folder is not None:
            run.write_stress(outcomes, found, folder)
        if folder is not None and model is not None and save_worst:
            run.save_worst(outcomes, config, seed, plants, look, model, folder, save_worst)
    show_or_write([run.stress_table(found), *run.cause_tables(found)], found, json)

"""`exosight train`: a network from a dataset."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

from exosight.app.commands.options import Seed
from exosight.app.console import progress, say
from exosight.errors import DataError, InputError
from exosight.learning.config import TrainConfig

DEFAULT = TrainConfig()


def train(
    data: Path,
    out: Path,
    extra_data: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="PATH …", help_behavior_hint="")] = (),
    online_designs: Annotated[int, tyro.conf.arg(metavar="DESIGNS")] = 0,
    pretrained: Annotated[str | None, tyro.conf.arg(metavar="MODEL", help_behavior_hint="")] = None,
    protocol: Literal["design", "frame", "family", "variation"] = "design",
    held_out: Annotated[str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint="")] = None,
    split_seed: Seed = 0,
    resume: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    config: Annotated[TrainConfig, tyro.conf.arg(name="")] = DEFAULT,
) -> None:
    """Train a network to estimate the sensors of a system from an image, and export it as ONNX.

    A stopped run goes on exactly where it was with --resume. The folder gets the checkpoint, the loss curves
    (history.csv) and the network (model.onnx), each with configuration, seed and identity of the data.
    Started by torchrun, several processes, each with a GPU of its own, train one network.

    With --pretrained it goes on from a network that was trained before, such as the shipped one: what differs
    little, such as another camera or finger of the same sensors, it then learns in minutes.

    Examples:
      exosight train --data results/data --out results/light
      exosight train --data mine --out adapted --pretrained shipped --epochs 4

    Args:
        data: folder of a dataset, from `exosight generate`
        out: folder of the run; it must not exist, unless --resume
        extra_data: folders of further datasets to learn from; what --data keeps for testing is left out of
            them, as is what --held-out names
        online_designs: designs of each scenario simulated anew for every epoch, and learned from in it alone
        pretrained: a network to start from in place of random weights: its model.onnx, or
            'shipped', the package's own for this system
        protocol: how frames are divided 60/20/20 %: design (unseen designs), frame (the paper's), or with the
            test part that --held-out names: family or variation (unseen stiffness, unseen cameras)
        held_out: what is kept for testing: a family of designs, or something that varies in the dataset, such
            as plant.young or appearance.roll, whose largest fifth is
        split_seed: seed of the division
        resume: go on with the run that the folder holds
        config: network, recipe and seed
    """
    if out.exists() and not resume:
        raise DataError(f"{out}: exists already; name a new folder, or add --resume to go on with its run")
    if online_designs < 0 or (online_designs and protocol in ("family", "variation")):
        raise InputError(
            f"--online-designs: expected 0 or more, and not with --protocol {protocol}, as they would "
            f"hold what is held out, got {online_designs}"
        )
    # Here, so that --help and wrong options answer at once.
    from exosight.app.data import divided, load
    from exosight.app.pipeline import MODEL, Sources, check_training, fit

    check_training()
    from exosight.control.estimator import model_path
    from exosight.evaluation.naming import common_unit
    from exosight.learning import load_pretrained
    from exosight.learning.parallel import join

    with join(config.device) as group:
        loaded = load(data)
        schema = loaded.frames.schema
        begun = load_pretrained(model_path(Path(pretrained), schema)) if pretrained else None
        split = divided(loaded, protocol, split_seed, held_out)
        with progress("training", "steps") as update:
            history = fit(
                loaded,
                split,
                config,
                out,
                sources=Sources(extra_data, online_designs, begun),
                resume=resume,
                progress=update,
                group=group,
            )
    if not group.first:
        return
    parts = (len(split.train), len(split.validation), len(split.test))
    say("frames: {} training, {} validation, {} test".format(*parts))
    best = min((r for r in history if r.validation_loss is not None), key=lambda r: r.validation_loss or 0.0)
    error = f"{best.validation_l1:.4f} {common_unit(loaded.frames.schema)}".rstrip()
    say(f"best epoch {best.epoch} of {len(history)}: mean absolute error on validation frames {error}")
    say(f"wrote {out / MODEL}")

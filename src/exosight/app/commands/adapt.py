"""`exosight adapt`: a network, changed by a few labelled pictures of another set-up."""

from pathlib import Path
from typing import Annotated, Literal

import tyro
from pydantic import Field

from exosight.app.commands.options import Json, Seed
from exosight.app.console import check_json_target, progress, results_folder, say, show_or_write, to_json
from exosight.files import write_new_file

Labels = Annotated[int | None, Field(ge=0), tyro.conf.arg(metavar="N", help_behavior_hint="")]


def adapt(
    data: Path,
    out: Path,
    model: Annotated[str, tyro.conf.arg(metavar="MODEL")] = "shipped",
    labels: Labels = None,
    method: Literal["auto", "none", "affine", "last", "all"] = "auto",
    split_seed: Seed = 0,
    seed: Seed = 0,
    json: Json = None,
) -> None:
    """Adapt a network to another set-up with a few labelled pictures: a moved camera, another device or user.

    What changes is chosen by cross-validation: nothing, gain and offset of each output, the last layer, or
    all layers; each on pictures as they are, and registered to the camera that the network knows. How the
    camera has moved is found from pictures without labels too, so --labels 0 mends a camera that was bumped.

    Sequences that are kept for testing are only looked at to say how good the network is before and after.
    Intervals are calibrated anew from what cross-validation left out, and so is the OOD score's limit.

    The sensors may be others than those of the network; the size of the pictures must be its own.

    Examples:
      exosight adapt --data bumped --model own/model.onnx --labels 30 --out new
      exosight adapt --data bumped --model own/model.onnx --labels 0 --out new

    Args:
        data: folder of a dataset, from `exosight import` or `exosight generate`
        out: folder to make; it gets the network (model.onnx) and the numbers (adaptation.json)
        model: the network to adapt: its model.onnx, or 'shipped', the package's own for this system
        labels: how many labelled pictures may be learned from, drawn evenly from all sequences that are not
            for testing; by default all of them, 2000 at most
        method: what changes; auto: what cross-validation finds best
        split_seed: seed of the division in parts to learn from and for testing, as of `exosight train`
        seed: decides which pictures are drawn, and the search
        json: write the numbers as JSON to a new file, or to stdout with "-", instead of tables
    """
    check_json_target(json)
    # Here, so that --help and wrong options answer at once.
    from exosight.app.adaptation import adapt as run
    from exosight.app.data import divided, load
    from exosight.app.pipeline import MODEL, check_training

    check_training()
    from exosight.control.estimator import model_path

    with results_folder(out) as folder:
        assert folder is not None
        loaded = load(data)
        split = divided(loaded, "design", split_seed, None)
        place = model_path(Path(model), loaded.frames.schema)
        with progress("adapting", "fits") as update:
            found = run(loaded, split, place, labels, method, seed, folder, MODEL, update)
        write_new_file(folder / "adaptation.json", to_json(found.record).encode())
    if found.chosen.registered:
        say("the camera has moved: pictures are registered to the one that the network knows")
    show_or_write(found.tables, found.record, json)

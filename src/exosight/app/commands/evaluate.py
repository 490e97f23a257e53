"""`exosight evaluate`: a network on a dataset."""

from pathlib import Path

from exosight.app.commands.options import Json, MaybePath, Plot, Seed
from exosight.app.console import check_json_target, results_folder, say, show_or_write
from exosight.app.output import check_plot


def evaluate(
    data: Path,
    model: MaybePath = None,
    out: MaybePath = None,
    seed: Seed = 0,
    plot: Plot = None,
    json: Json = None,
) -> None:
    """Evaluate a network: accuracy, intervals, robustness, and detection of out-of-distribution images.

    On the dataset that the network was trained on, only the test part of its split counts, and what is known
    without an image stands beside; on any other of its system, all frames do. Images are taken clean, with
    the paper's noise and contrast, and out of distribution. Of the published system, the paper's values stand
    beside.

    Example:
      exosight evaluate --data results/data
      exosight evaluate --data results/data --model results/light/model.onnx

    Args:
        data: folder of a dataset
        model: exported network, from `exosight train`; the package's own for the dataset's system if left out
        out: folder for tables, estimates (CSV, JSON), figures (HTML) and configuration; it must not exist
        seed: seed of the noise, and of the out-of-distribution images
        plot: draw true and estimated values of random frames, to a new file (PNG, PDF or SVG)
        json: write the scores as JSON to a new file, or to stdout with "-", instead of tables
    """
    check_json_target(json)
    check_plot(plot)
    # Here, so that --help and wrong options answer at once: Matplotlib takes a second to import.
    from exosight.app.data import load
    from exosight.app.evaluation import evaluate as run
    from exosight.app.evaluation import write_evaluation
    from exosight.app.plots import write_plot
    from exosight.control.estimator import OnnxEstimator, model_name, model_path
    from exosight.evaluation.figures import sample_traces

    with results_folder(out) as folder:
        loaded = load(data)
        place = model_path(model, loaded.frames.schema)
        estimator = OnnxEstimator.load(place, threads=2)
        found = run(estimator, loaded, seed)
        say(found.frames)
        if folder is not None:
            about = {"model": model_name(place), "data": str(data), "seed": seed}
            write_evaluation(found, about, estimator, folder)
    if plot is not None:
        write_plot(sample_traces(found.schema, found.true, found.estimated), plot)
    values = {"frames": found.frames, **{table.name: table.records() for table in found.tables}}
    show_or_write(found.tables, values, json)

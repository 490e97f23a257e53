"""`exosight evaluate`: a network judged beside the paper's."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from exosight.app.console import say, show, write_json
from exosight.app.pipeline import judge, load, test_part
from exosight.app.report import Picture, Report, Section, write_report, write_tables
from exosight.control.estimator import OnnxEstimator
from exosight.evaluation import (
    contact_table,
    evaluate_robustness,
    figures,
    largest_table,
    robustness_table,
    score,
)


def evaluate(
    model: Path,
    data: Path,
    out: Path | None = None,
    seed: int = 0,
    json: Annotated[str | None, tyro.conf.arg(metavar="FILE|-")] = None,
) -> None:
    """Judge a network: RMSE, RMS% of range and Pearson r of each contact, clean and on degraded images.

    On the dataset that the network learned from, only the test part of its split counts; on any other, all
    frames do. The paper's values stand beside.

    Example: exosight evaluate --model results/light/model.onnx --data results/data

    Args:
        model: exported network, from `exosight train`
        data: folder of a dataset
        out: folder for tables (CSV, JSON), figures (HTML page) and configuration; it must not exist
        seed: seed of the noise
        json: write the scores as JSON to a new file, or to stdout with "-", instead of tables
    """
    estimator = OnnxEstimator.load(model, threads=2)
    loaded = load(data)
    index, meaning = test_part(estimator.card, loaded)
    say(f"{len(index)} frames: {meaning}")
    true, estimated = judge(estimator, loaded, index)
    scores = score(true, estimated)
    cases = evaluate_robustness(estimator.estimate, loaded.frames.images[index], true, seed)
    tables = (
        contact_table("contacts", "Each contact", scores),
        largest_table("largest_forces", "Largest forces", scores),
        robustness_table("robustness", "Mean ± SD over C1…C7 on degraded images", cases),
    )
    if json is None:
        for table in tables:
            show(table)
    else:
        write_json({"frames": meaning, **{table.name: table.records() for table in tables}}, json)
    if out is None:
        return
    report = Report(
        title="Evaluation of a force estimator",
        summary=f"{model} on {len(index)} frames of {data}: {meaning}.",
        sections=(
            Section("Scores", tables),
            Section(
                "Figures",
                tuple(
                    Picture(figure, caption, caption)
                    for figure, caption in (
                        (
                            figures.sample_traces(true, estimated),
                            "True and estimated force of random frames.",
                        ),
                        (figures.predicted_against_true(true, estimated), "Estimated over true force."),
                        (figures.rainclouds(true, estimated), "Distribution of true and estimated forces."),
                        (figures.robustness_bars(cases), "Errors on degraded images beside the paper's."),
                    )
                ),
            ),
        ),
        footer=f"exosight {estimator.card.exosight_version}; noise seed {seed}",
    )
    write_tables(report, out)
    write_report(report, out / "evaluation.html")
    write_json(
        {"model": str(model), "data": str(data), "seed": seed, "card": asdict(estimator.card)},
        str(out / "config.json"),
    )
    np.savetxt(out / "forces.csv", np.hstack([true, estimated]), delimiter=",", header=_HEADER, comments="")
    say(f"wrote {out}")


_HEADER = ",".join([f"C{i} true [N]" for i in range(1, 8)] + [f"C{i} estimated [N]" for i in range(1, 8)])

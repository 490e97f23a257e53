"""What one image of `index` tells, beside the errors of the shipped network on the same frames.

    exosight generate --system index --per-scenario 125 --out DATA     13 minutes on two cores, busy
    python docs/identifiability_frames.py DATA                         2 minutes

writes docs/results/identifiability.json, which docs/figures_identifiability.py draws: of the frames of unseen
exosuits all in which C7 is touched, and for the other forces a random part of all.
"""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from identifiability import MATERIAL_KNOWN, at_poses, resolved
from jaxtyping import Bool, Float, Int

from exosight.app.data import Data, load
from exosight.app.provenance import test_part
from exosight.control.estimator import SHIPPED_MODELS, OnnxEstimator
from exosight.exosuit.catalogue import find_system
from exosight.exosuit.published import PublishedDesigns

RESULT = Path(__file__).parent / "results" / "identifiability.json"
OTHERS = 600
"""Frames beside those in which C7 is touched."""
SHOWN = ("C7", "F_net")
"""Of which every frame is stored."""
NOISES = (0.1, 0.03)
"""Of an outline point [pixels]."""


def chosen_frames(
    data: Data, test: Int[np.ndarray, " frames"]
) -> tuple[Int[np.ndarray, " chosen"], Bool[np.ndarray, " chosen"]]:
    """Those with a force on C7, and OTHERS of all; which of them are the latter."""
    touched = data.frames.reading("C7") > 0
    others = np.random.default_rng(0).choice(test, OTHERS, replace=False)
    chosen = np.union1d(test[touched[test]], others)
    return chosen, np.isin(chosen, others)


def bounds(data: Data, chosen: Int[np.ndarray, " chosen"]) -> dict[float, Float[np.ndarray, "chosen forces"]]:
    """What `resolved` says of each frame, by the noise; NaN where a contact is free [N]."""
    designs = find_system("index")
    assert isinstance(designs, PublishedDesigns)
    drawn = {design.number: design for design in data.manifest.designs}
    found = {noise: np.full((len(chosen), 8), np.nan) for noise in NOISES}
    numbers = data.frames.design[chosen]
    for number in np.unique(numbers):
        rows = np.flatnonzero(numbers == number)
        at = chosen[rows]
        of = at_poses(
            designs.exosuit(drawn[int(number)]),
            data.frames.commands[at, 0].astype(float),
            data.frames.pose[at],
            np.ones(len(at), bool),
            surfaces=True,
        )
        # Labels are stored in single precision.
        np.testing.assert_allclose(of.forces, data.frames.labels[at], atol=1e-6)
        for noise in NOISES:
            found[noise][rows] = resolved(of, MATERIAL_KNOWN, noise)
    return found


def measure(data: Data) -> dict[str, Any]:
    """Of each contact and of F_net: the bounds, and the errors of the network on the same frames."""
    estimator = OnnxEstimator.load(SHIPPED_MODELS["index"])
    test, _ = test_part(estimator.card, data)
    chosen, sampled = chosen_frames(data, test)
    found = bounds(data, chosen)
    true, estimated = (
        np.column_stack([forces, forces.sum(axis=1)]).astype(float)
        for forces in (data.frames.labels[test], estimator.estimate(data.frames.images[test]))
    )
    places = np.searchsorted(test, chosen)
    error, closed = (estimated - true)[places], true[places] > 0
    rows = {}
    for i, name in enumerate((*(spec.name for spec in data.frames.schema.estimated), "F_net")):
        own = closed[:, i] & (sampled | (name == "C7"))
        share = np.mean(true[:, i] > 0) * np.var(true[:, i]) ** -1
        rows[name] = {
            "touched [%]": 100 * float(np.mean(true[:, i] > 0)),
            "frames": int(own.sum()),
            "resolved [N]": {f"{noise:g}": rms(of[own, i]) for noise, of in found.items()},
            "RMSE where touched [N]": rms(error[own, i]),
            "RMSE [N]": rms(estimated[:, i] - true[:, i]),
            "error where not touched [%]": 100
            * float(
                np.sum((estimated - true)[true[:, i] == 0, i] ** 2) / np.sum((estimated - true)[:, i] ** 2)
            ),
            "r": float(np.corrcoef(true[:, i], estimated[:, i])[0, 1]),
            "r at the bound": {
                f"{noise:g}": float(np.sqrt(1 - share * rms(of[own, i]) ** 2)) for noise, of in found.items()
            },
        }
        if name in SHOWN:
            rows[name]["shown"] = {
                "resolved [N]": found[NOISES[0]][own, i].round(6).tolist(),
                "error [N]": np.abs(error[own, i]).round(6).tolist(),
            }
    return rows


def rms(values: Float[np.ndarray, " some"]) -> float:
    """√ mean x²."""
    return float(np.sqrt(np.mean(values**2)))


def main() -> None:
    """Write the numbers."""
    RESULT.write_text(json.dumps(measure(load(Path(sys.argv[1])))) + "\n")


if __name__ == "__main__":
    main()

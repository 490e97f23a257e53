"""What a network reads off a picture, and what the guard makes of it, as JSON values."""

from typing import Any

import numpy as np
from jaxtyping import UInt8

from exosight.control import Measurement
from exosight.control.at_rest import observer
from exosight.control.estimator import Reading
from exosight.system.schema import Schema


def reading_of(reading: Reading, schema: Schema) -> dict[str, Any]:
    """A reading of one image: by sensor, what is estimated and the sums of it [each in its unit]."""
    columns = (reading.forces, reading.low, reading.high, reading.contact)
    rows = np.stack([column[0] for column in columns], axis=-1).tolist()
    estimates = {
        name: dict(zip(("value", "low", "high", "contact"), (round(each, 5) for each in row), strict=True))
        for name, row in zip(schema.outputs, rows, strict=True)
    }
    for name in schema.controllable:
        if name not in estimates:
            estimates[name] = {"value": round(float(schema.weights(name) @ reading.forces[0]), 5)}
    return {"estimates": estimates, "ood_score": float(reading.ood_score[0])}


def judge(image: UInt8[np.ndarray, "height width"], reading: Reading, schema: Schema) -> dict[str, str]:
    """The state of a guard at rest that is shown this picture twice, and why.

    Its limits are those by default; no law acts, so the paths it knows are flat.
    """
    guarded = observer(schema)
    for _ in range(guarded.guard.bad_frames):
        guarded.step(0.0, Measurement(image, reading))
    cause = guarded.log[-1].cause if guarded.log else "picture and estimate can be trusted"
    return {"state": guarded.state.value, "cause": cause}

"""`exosight identify`: what the file of a rig says of its loads."""

import numpy as np
import pytest

from exosight.app.commands.identify import _as_driven, _with_gain
from exosight.control.trials import CONTROL_SHAPE
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.index_file import index_values
from exosight.system.build import build
from exosight.system.file import describe, replaced


@pytest.mark.parametrize(("found", "used"), [(0.04, 50.0), (0.04, 130.0), (0.04, 400.0)])
def test_a_rig_is_driven_as_far_as_its_preset_or_as_it_was_pictured(found: float, used: float) -> None:
    """With the gain that was found, whatever was assumed."""
    preset = index_values(Exosuit(CONTROL_SHAPE))
    (channel,) = build(describe(preset)).schema.channels
    assumed = _with_gain(preset, "0.1 N/kPa")
    (wide,) = build(describe(assumed)).schema.channels
    # Room for a gain that is ten times less.
    assert wide.high == pytest.approx(100 * channel.high, rel=1e-12)
    fitted = replaced(assumed, {"actuators.u.gain": f"{found} N/kPa"})
    (driven,) = build(
        describe(_as_driven(fitted, preset, np.array([[0.0], [-used], [10.0]])))
    ).schema.channels
    assert driven.unit == "kPa"
    assert driven.high == -driven.low == pytest.approx(max(channel.high / found, used), rel=1e-12)
    assert driven.peak == pytest.approx(max(channel.peak / found, used), rel=1e-12)

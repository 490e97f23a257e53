"""Plants and controllers with a closed form, see `toy`."""

import pytest
from toy import ToyPlant, controller

from exosight.control import ControllerConfig


@pytest.fixture
def toy() -> type[ToyPlant]:
    return ToyPlant


@pytest.fixture
def straight_config() -> ControllerConfig:
    """What a controller knows of a plant whose C3 presses with 0.1 u."""
    return controller()

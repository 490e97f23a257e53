"""What the episodes of the published system are about, tuned once."""

import pytest

from exosight.control.stress.plants import StressPlants, stress_plants
from exosight.exosuit.published import PublishedDesigns


@pytest.fixture(scope="session")
def plants() -> StressPlants:
    return stress_plants(PublishedDesigns())

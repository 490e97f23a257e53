"""A simulated plant in the place of camera and actuator (needs JAX)."""

from exosight.control.paths import ControllerConfig
from exosight.control.realtime import REAL_TIME, Clock
from exosight.control.simulated import SimulatedPlant
from exosight.control.sources import Frame


class SimulatedDevice:
    """Source and actuator of the loop in real time: it renders when looked at, and solves when actuated.

    plant    that is looked at and actuated
    config   of the controller: which channel it drives; the others rest at 0
    """

    def __init__(self, plant: SimulatedPlant, config: ControllerConfig, clock: Clock = REAL_TIME) -> None:
        self._plant, self._config, self._clock = plant, config, clock
        plant.reset()

    def __iter__(self) -> "SimulatedDevice":
        return self

    def __next__(self) -> Frame:
        seen = self._plant.look()
        return Frame(seen.image, self._clock.now(), seen.commands, seen.outputs)

    def apply(self, u: float) -> None:
        """Change the command of the driven channel to u [its unit] and come to rest."""
        self._plant.move(self._config.commands(u))

    def close(self) -> None:
        """Do nothing: it is a simulation."""

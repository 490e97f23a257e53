"""A simulated plant in the place of camera and actuator (needs JAX)."""

from exosight.control.realtime import REAL_TIME, Clock
from exosight.control.simulated import SimulatedPlant
from exosight.control.sources import Frame


class SimulatedDevice:
    """Source and actuator of the loop in real time: it renders when looked at, and solves when actuated."""

    def __init__(self, plant: SimulatedPlant, clock: Clock = REAL_TIME) -> None:
        self._plant, self._clock = plant, clock
        plant.reset()

    def __iter__(self) -> "SimulatedDevice":
        return self

    def __next__(self) -> Frame:
        seen = self._plant.look()
        return Frame(seen.image, self._clock.now(), seen.u, seen.forces[1:])

    def apply(self, u: float) -> None:
        """Change the actuation to u [N] and come to rest."""
        self._plant.move(u)

    def close(self) -> None:
        """Do nothing: nobody wears it."""

"""A plant with a closed form: F = c · max(u − u₀, 0), all of it on C3."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from exosight.control import ControllerConfig, ForcePath, Observation
from exosight.errors import InputError


@dataclass
class ToyPlant:
    stiffness: float = 0.1
    contact_at: float = 0.0
    limit: float = 6.0
    applied: list[float] = field(default_factory=list)

    def reset(self) -> Observation:
        self.applied = []
        return self.look(0.0)

    def apply(self, u: float) -> Observation:
        if not abs(u) <= self.limit:
            raise InputError(f"actuation u: expected a number within ±{self.limit:g} N, got {u}")
        self.applied.append(u)
        return self.look(u)

    def look(self, u: float) -> Observation:
        forces = np.zeros(8)
        forces[0] = 7.0  # C0 is never part of F_net
        forces[3] = self.stiffness * max(u - self.contact_at, 0.0)
        image = np.full((4, 6), np.clip(100 * forces[3], 0, 255), np.uint8)
        return Observation(u, image, forces, q=np.array([u]), converged=True, min_eigenvalue=1.0)


@pytest.fixture
def toy() -> type[ToyPlant]:
    return ToyPlant


@pytest.fixture
def straight_config() -> ControllerConfig:
    """What a controller knows of a plant whose C3 presses with 0.1 u, at 10 steps a second and 1 N a step."""

    def path(u: np.ndarray) -> ForcePath:
        forces = np.zeros((len(u), 7))
        forces[:, 2] = 0.1 * np.maximum(u, 0.0)
        return ForcePath(u, forces, np.zeros(len(u), bool))

    return ControllerConfig(
        loading=path(np.linspace(0.0, 5.0, 51)),
        unloading=path(np.linspace(5.0, -1.0, 61)),
        contact_limit=np.full(7, 0.4),
        rate=10.0,
        period=0.1,
        smallest_gain=5.0,
        largest_gain=20.0,
    )

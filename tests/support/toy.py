"""Plants and controllers in closed form, with the names of a made-up system: C0 … C7, F_net, u."""

from dataclasses import dataclass, field

import numpy as np

from exosight.control import ControllerConfig, ForcePath, Observation
from exosight.system.schema import Channel, Schema, SensorSpec, ViewSpec

SLOPE = 0.1
"""∂F/∂u of C3 [N/N]."""

CHANNEL = Channel("u", "N", -6.0, 6.0, drive=4.0)
ZONES = tuple(SensorSpec(f"C{i}", "contact force", "N", estimated=i > 0) for i in range(8))
NET = SensorSpec("F_net", "net force", "N", parts=tuple(zone.name for zone in ZONES[1:]))
SCHEMA = Schema("toy", (CHANNEL,), (*ZONES, NET), (ViewSpec("camera", 6, 4),))
WEIGHTS = SCHEMA.weights("F_net")


def force_path(u: np.ndarray, outputs: np.ndarray, snapped: np.ndarray | None = None) -> ForcePath:
    """A path whose controlled sensor is the sum of all outputs."""
    return ForcePath(u, outputs, outputs.sum(axis=1), np.zeros(len(u), bool) if snapped is None else snapped)


def straight(u: np.ndarray) -> ForcePath:
    """C3 presses with 0.1 u, nothing jumps."""
    outputs = np.zeros((len(u), 7))
    outputs[:, 2] = SLOPE * np.maximum(u, 0.0)
    return force_path(u, outputs)


def controller(
    loading: ForcePath | None = None,
    unloading: ForcePath | None = None,
    limit: float = 0.4,
    rate: float = 10.0,
    schema: Schema = SCHEMA,
) -> ControllerConfig:
    """At 10 steps a second and 1 N a step; by default of the straight path from 5 N to −1 N."""
    return ControllerConfig(
        schema=schema,
        sensor="F_net",
        channel="u",
        loading=loading or straight(np.linspace(0.0, 5.0, 51)),
        unloading=unloading or straight(np.linspace(5.0, -1.0, 61)),
        output_limits=np.full(7, limit),
        rate=rate,
        period=0.1,
        smallest_gain=5.0,
        largest_gain=20.0,
    )


@dataclass
class ToyPlant:
    """F = c · max(u − u₀, 0), all of it on C3."""

    stiffness: float = 0.1
    contact_at: float = 0.0
    applied: list[float] = field(default_factory=list)
    schema: Schema = SCHEMA

    def reset(self) -> Observation:
        self.applied = []
        return self.look(0.0)

    def apply(self, commands: np.ndarray) -> Observation:
        (u,) = self.schema.check_commands(commands).tolist()
        self.applied.append(u)
        return self.look(u)

    def look(self, u: float) -> Observation:
        zones = np.zeros(8)
        zones[0] = 7.0  # C0 is never part of F_net
        zones[3] = self.stiffness * max(u - self.contact_at, 0.0)
        image = np.full((4, 6), np.clip(100 * zones[3], 0, 255), np.uint8)
        readings = np.append(zones, zones[1:].sum())
        return Observation(self.schema, np.array([u]), image, readings, np.array([u]), True, 1.0)

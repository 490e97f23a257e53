"""What may go wrong in an episode, and how often; needs no JAX."""

from typing import Annotated, Literal, get_args

from pydantic import AfterValidator, ConfigDict, Field
from pydantic.dataclasses import dataclass as configuration

from exosight.validation import rising

Kind = Literal["constant", "snap", "steps", "ramp", "sine"]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""What targets do until they drop to 0; `snap` is a constant one where the nominal system snaps."""

ControllerName = Literal["guarded", "adaptive", "learned", "unguarded", "oracle"]
"""The scheduled law behind its guard; the adaptive controller; this with a learned correction, and the same
with full authority whatever it knows; the bound of all, which feels the true force at once and knows plant
and user."""

Share = Annotated[float, Field(ge=0, le=1)]
Delay = Annotated[float, Field(ge=0, le=2)]
Positive = Annotated[float, Field(gt=0, le=10)]


@configuration(frozen=True, config=ConfigDict(extra="forbid"))
class StressConfig:
    """What may go wrong, and how often."""

    hold_seconds: Annotated[float, Field(ge=1.5, le=60)] = 3.0
    """time until the target drops [s]"""
    release_seconds: Annotated[float, Field(ge=1.1, le=60)] = 1.5
    """time after that [s]"""
    targets: Annotated[tuple[Positive, Positive], AfterValidator(rising)] | None = None
    """targets [unit of the sensor]; default: 0.1…0.4 N for the published system, shares of the largest
    reading within the limits for another"""
    latency: Annotated[tuple[Delay, Delay], AfterValidator(rising)] = (0.0, 0.3)
    """age of the frames [s], in whole steps of 0.1 s; one for each episode"""
    lag: Annotated[tuple[Delay, Delay], AfterValidator(rising)] = (0.0, 0.0)
    """of the actuators [s]: time in which they go 63 % of the way to a command; one for each episode"""
    dead_time: Annotated[tuple[Delay, Delay], AfterValidator(rising)] = (0.0, 0.0)
    """of the actuators [s]: time before anything of a command arrives; one for each episode"""
    dropped: Annotated[tuple[Share, Share], AfterValidator(rising)] = (0.0, 0.2)
    """share of the frames that never come; one for each episode"""
    repeated: Annotated[tuple[Share, Share], AfterValidator(rising)] = (0.0, 0.1)
    """share of the frames in whose place the one before comes again"""
    bursts: Annotated[int, Field(ge=0, le=10)] = 2
    """spells of up to 1 s of noise or of something in front of the camera, in each episode"""
    wrong_plant: bool = True
    """the system differs from the one that the controller was tuned for: modulus, finger and mount of the
    published one, what `vary` tables say of a file's"""
    wrong_camera: bool = True
    """in every third episode the camera stands up to 2 mm off and is up to 3 % too near or too far"""
    moving_user: bool = True
    """in every other episode joints stiffen or soften, and rest flexed by up to 10°"""

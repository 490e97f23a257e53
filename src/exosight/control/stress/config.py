"""What may go wrong in an episode, and how often; needs no JAX."""

from typing import Annotated, Literal, get_args

from pydantic import AfterValidator, ConfigDict, Field
from pydantic.dataclasses import dataclass as configuration

from exosight.exosuit.variation import PlantVariation
from exosight.validation import rising

Kind = Literal["constant", "snap", "steps", "ramp", "sine"]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""What targets do until they drop to 0 N; `snap` is a constant one where the nominal exosuit snaps."""

SNAP_TARGETS = (0.26, 0.34)
"""Constant targets around the jump of the nominal exosuit's F_net [N]."""

Share = Annotated[float, Field(ge=0, le=1)]
Delay = Annotated[float, Field(ge=0, le=2)]
Positive = Annotated[float, Field(gt=0, le=10)]

WRONG_PLANT = PlantVariation(
    link_length=(0.97, 1.03),
    finger_radius=(0.95, 1.05),
    joint_stiffness=(0.8, 1.25),
    young=(0.8, 1.25),
    gap=(0.0, 0.0005),
    mount_angle=(-0.02, 0.02),
    mount_offset=(-0.002, 0.002),
)
"""By how much exosuit, finger and mount differ from those that the controller was tuned for."""


@configuration(frozen=True, config=ConfigDict(extra="forbid"))
class StressConfig:
    """What may go wrong, and how often."""

    hold_seconds: Annotated[float, Field(ge=1.5, le=60)] = 3.0
    """time until the target drops [s]"""
    release_seconds: Annotated[float, Field(ge=1.1, le=60)] = 1.5
    """time after that [s]"""
    targets: Annotated[tuple[Positive, Positive], AfterValidator(rising)] = (0.1, 0.4)
    """targets [N]"""
    latency: Annotated[tuple[Delay, Delay], AfterValidator(rising)] = (0.0, 0.3)
    """age of the frames [s], in whole steps of 0.1 s; one for each episode"""
    dropped: Annotated[tuple[Share, Share], AfterValidator(rising)] = (0.0, 0.2)
    """share of the frames that never come; one for each episode"""
    repeated: Annotated[tuple[Share, Share], AfterValidator(rising)] = (0.0, 0.1)
    """share of the frames in whose place the one before comes again"""
    bursts: Annotated[int, Field(ge=0, le=10)] = 2
    """spells of up to 1 s of noise or of something in front of the camera, in each episode"""
    wrong_plant: bool = True
    """modulus, finger and mount differ from those that the controller was tuned for"""
    wrong_camera: bool = True
    """in every third episode the camera stands up to 2 mm off and is up to 3 % too near or too far"""
    moving_user: bool = True
    """in every other episode joints stiffen or soften, and rest flexed by up to 10°"""

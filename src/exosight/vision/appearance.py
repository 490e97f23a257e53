"""How pictures of the same scene may differ, and how each one does: numbers drawn frame by frame.

`exosight.vision.augment` makes a picture what its row of numbers says.
"""

import dataclasses
from typing import Annotated

import numpy as np
from jaxtyping import Float64, Integer
from pydantic import AfterValidator, ConfigDict, Field
from pydantic.dataclasses import dataclass

from exosight.errors import InputError
from exosight.validation import rising
from exosight.vision.background import BACKGROUNDS, HELD_OUT_BACKGROUNDS, Background
from exosight.vision.counter_rng import Seed, pick, uniforms
from exosight.vision.occlusion import HELD_OUT_OCCLUSIONS, OCCLUSIONS, Occlusion

Share = Annotated[float, Field(ge=0.0, le=1.0)]
Fingers = Annotated[int, Field(ge=0, le=4)]

BACKGROUND_KINDS: tuple[Background, ...] = BACKGROUNDS + HELD_OUT_BACKGROUNDS
"""What an Appearance's `background` counts, from 1; 0 is the renderer's."""
OCCLUSION_KINDS: tuple[Occlusion, ...] = OCCLUSIONS + HELD_OUT_OCCLUSIONS
"""What an Appearance's `occlusion` counts, from 1; 0 is none."""


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class AppearanceVariation:
    """How far finished pictures may differ; whatever is 0, or empty, is off.

    Every switch has draws of its own: turning one on or off leaves the others as they were.
    """

    share: Share = 1.0
    """share of the frames that each switch acts on, drawn switch by switch"""
    shift: Annotated[float, Field(ge=0.0, le=0.5)] = 0.0
    """largest shift of the camera, as a share of the picture's sides"""
    roll: Annotated[float, Field(ge=0.0, le=3.15)] = 0.0
    """largest turn of the camera about its axis [rad]"""
    zoom: Share = 0.0
    """largest enlargement: 0.2 is from 1/1.2 to 1.2"""
    tilt: Annotated[float, Field(ge=0.0, le=0.7)] = 0.0
    """largest angle between the camera's axis and the normal of the scene, each way [rad]"""
    distortion: Annotated[float, Field(ge=0.0, le=0.2)] = 0.0
    """largest radial distortion of the lens at the picture's corners, as a share of their distance"""
    body_contrast: Annotated[float, Field(ge=0.0, le=0.9)] = 0.0
    """largest share of the range of grays that the bodies lose"""
    backgrounds: tuple[Background, ...] = ()
    """kinds of background"""
    occlusions: tuple[Occlusion, ...] = ()
    """kinds of object that hides a part of the bodies"""
    occluded: Annotated[tuple[Share, Share], AfterValidator(rising)] = (0.02, 0.15)
    """share of the picture that an object covers"""
    fingers_behind: Fingers = 0
    """largest number of other fingers behind the bodies"""
    fingers_in_front: Fingers = 0
    """largest number of other fingers in front of them"""
    gradient: Share = 0.0
    """largest relative change of brightness from the middle of the picture to its corners, across it"""
    vignette: Share = 0.0
    """largest relative loss of brightness at the corners"""
    blur: Annotated[float, Field(ge=0.0, le=20.0)] = 0.0
    """largest standard deviation of Gaussian blur [pixels]"""
    motion: Annotated[float, Field(ge=0.0, le=60.0)] = 0.0
    """largest length of motion blur [pixels]"""
    contrast: Annotated[float, Field(ge=0.0, le=0.95)] = 0.0
    """largest share of the range of grays that the picture loses; the paper's two cases lose 0.32 and 0.74"""
    gamma: Annotated[float, Field(ge=0.0, le=3.0)] = 0.0
    """largest change of the exponent of brightness, in octaves: 1 is from 1/2 to 2"""
    noise: Share = 0.0
    """largest variance of Gaussian noise [full scale²]; the paper's cases are 0.001, 0.01 and 0.1"""
    shot: Share = 0.0
    """largest variance of shot noise at white [full scale²]; it is proportional to brightness"""


Column = Float64[np.ndarray, " frames"]


@dataclasses.dataclass(frozen=True)
class Appearance:
    """What is done to each picture, in this order; zeros, and a zoom and exponent of 1, do nothing."""

    shift_x: Column
    """Shift to the right, as a share of the width."""
    shift_y: Column
    """Shift downwards, as a share of the height."""
    roll: Column
    """Clockwise turn about the picture's middle [rad]."""
    zoom: Column
    """Enlargement [-]."""
    tilt_x: Column
    """Turn of the scene about the picture's horizontal axis [rad]; positive takes its lower half away."""
    tilt_y: Column
    """Turn about its vertical axis [rad]; positive takes its right half away."""
    distortion: Column
    """Radial distortion at a corner, as a share of its distance; positive is a pincushion."""
    body_dark: Column
    """What black becomes on the bodies, 0…1."""
    body_range: Column
    """Range of grays that the bodies lose, 0…1."""
    background: Column
    """Place in BACKGROUND_KINDS, from 1; 0 is the renderer's own."""
    background_level: Column
    """Its mean gray, 0…1."""
    background_contrast: Column
    """Half its range of grays, 0…1."""
    background_size: Column
    """Its features' size, as a share of the width."""
    background_angle: Column
    """Its angle [rad]."""
    fingers_behind: Column
    """Number of other fingers behind the bodies."""
    fingers_in_front: Column
    """Number of other fingers in front of them."""
    occlusion: Column
    """Place in OCCLUSION_KINDS, from 1; 0 is none."""
    occluded: Column
    """Share of the picture that it covers."""
    occlusion_at: Column
    """Which of the bodies' pixels it is centred on, 0 (first) … 1 (last)."""
    occlusion_angle: Column
    """Its angle [rad]."""
    occlusion_shade: Column
    """Its gray, 0…1."""
    gradient: Column
    """Relative gain of brightness from the middle to a corner, in the direction of `gradient_angle`."""
    gradient_angle: Column
    """Direction in which the picture becomes brighter, clockwise from the right [rad]."""
    vignette: Column
    """Relative loss of brightness at the corners."""
    blur: Column
    """Standard deviation of Gaussian blur [pixels]."""
    motion: Column
    """Length of motion blur [pixels]."""
    motion_angle: Column
    """Its direction, clockwise from the right [rad]."""
    gamma: Column
    """Exponent of brightness [-]."""
    dark: Column
    """What black becomes, 0…1."""
    range: Column
    """Range of grays that is lost, 0…1: white becomes dark + 1 − range."""
    noise: Column
    """Variance of Gaussian noise [full scale²]; its mean is the paper's."""
    shot: Column
    """Variance of shot noise at white [full scale²]."""
    seed: Column
    """Of what is random beyond these numbers: a whole number below 2³²."""

    def __post_init__(self) -> None:
        lengths = {len(getattr(self, name)) for name in COLUMNS}
        if len(lengths) > 1:
            raise InputError(f"appearance: expected columns of one length, got lengths {sorted(lengths)}")

    def __len__(self) -> int:
        return len(self.seed)


COLUMNS: tuple[str, ...] = tuple(field.name for field in dataclasses.fields(Appearance))
"""The numbers of an appearance, in order: the columns of its table."""


def to_table(appearance: Appearance) -> Float64[np.ndarray, "frames columns"]:
    """All numbers as one array, with COLUMNS."""
    return np.stack([getattr(appearance, name) for name in COLUMNS], axis=-1)


def from_table(table: Float64[np.ndarray, "frames columns"]) -> Appearance:
    """The appearance that `to_table` wrote.

    Raises InputError for another number of columns.
    """
    if table.ndim != 2 or table.shape[1] != len(COLUMNS):
        raise InputError(f"appearance: expected a table of {len(COLUMNS)} columns, got {table.shape}")
    return Appearance(**dict(zip(COLUMNS, table.T, strict=True)))


def draw_appearance(
    variation: AppearanceVariation, seed: Seed, numbers: Integer[np.ndarray, " frames"]
) -> Appearance:
    """What is done to the frames with these numbers; each depends on the seed and its number alone.

    Raises InputError for a negative seed or number.
    """
    v, count = variation, len(COLUMNS)
    values = uniforms(seed, numbers, 2 * count)

    def share(name: str) -> Column:
        """Even in [0, 1)."""
        return values[:, COLUMNS.index(name)]

    def acts(switch: str) -> Column:
        """1 where a switch acts, 0 elsewhere; a switch goes by the name of its first column."""
        return (values[:, count + COLUMNS.index(switch)] < v.share).astype(float)

    def up_to(name: str, largest: float) -> Column:
        return acts(name) * largest * share(name)

    def either_way(name: str, largest: float, switch: str | None = None) -> Column:
        return acts(switch or name) * largest * (2 * share(name) - 1)

    def kind(name: str, chosen: tuple[str, ...], known: tuple[str, ...]) -> Column:
        places = [1 + known.index(each) for each in chosen] or [0]
        return acts(name) * pick(share(name), places)

    background = kind("background", v.backgrounds, BACKGROUND_KINDS)
    occlusion = kind("occlusion", v.occlusions, OCCLUSION_KINDS)
    low, high = v.occluded
    lost, body_lost = up_to("range", v.contrast), up_to("body_range", v.body_contrast)
    turn = 2 * np.pi
    half_range = 0.5 * share("background_contrast")
    return Appearance(
        shift_x=either_way("shift_x", v.shift),
        shift_y=either_way("shift_y", v.shift, "shift_x"),
        roll=either_way("roll", v.roll),
        zoom=(1 + v.zoom) ** either_way("zoom", 1.0),
        tilt_x=either_way("tilt_x", v.tilt),
        tilt_y=either_way("tilt_y", v.tilt, "tilt_x"),
        distortion=either_way("distortion", v.distortion),
        body_dark=body_lost * share("body_dark"),
        body_range=body_lost,
        background=background,
        # Neither end of the pattern is clipped.
        background_level=(half_range + (1 - 2 * half_range) * share("background_level")) * (background > 0),
        background_contrast=half_range * (background > 0),
        background_size=(0.05 + 0.45 * share("background_size")) * (background > 0),
        background_angle=turn * share("background_angle") * (background > 0),
        fingers_behind=acts("fingers_behind") * np.floor(share("fingers_behind") * (v.fingers_behind + 1)),
        fingers_in_front=acts("fingers_in_front")
        * np.floor(share("fingers_in_front") * (v.fingers_in_front + 1)),
        occlusion=occlusion,
        occluded=(low + (high - low) * share("occluded")) * (occlusion > 0),
        occlusion_at=share("occlusion_at") * (occlusion > 0),
        occlusion_angle=turn * share("occlusion_angle") * (occlusion > 0),
        occlusion_shade=share("occlusion_shade") * (occlusion > 0),
        gradient=up_to("gradient", v.gradient),
        gradient_angle=turn * share("gradient_angle"),
        vignette=up_to("vignette", v.vignette),
        blur=up_to("blur", v.blur),
        motion=up_to("motion", v.motion),
        motion_angle=turn * share("motion_angle"),
        gamma=2.0 ** either_way("gamma", v.gamma),
        dark=lost * share("dark"),
        range=lost,
        # The square: as many frames at every standard deviation.
        noise=up_to("noise", 1.0) ** 2 * v.noise,
        shot=up_to("shot", 1.0) ** 2 * v.shot,
        seed=np.floor(2.0**32 * share("seed")),
    )


TRAINING = AppearanceVariation(
    shift=0.04,
    roll=0.1,
    zoom=0.08,
    tilt=0.15,
    distortion=0.05,
    body_contrast=0.5,
    backgrounds=BACKGROUNDS,
    occlusions=OCCLUSIONS,
    occluded=(0.01, 0.05),
    fingers_behind=2,
    gradient=0.4,
    vignette=0.4,
    blur=1.0,
    motion=3.0,
    contrast=0.75,
    gamma=0.7,
    noise=0.1,
    shot=0.02,
    share=0.5,
)
"""A wide mixture to train with, the paper's noise and contrast within it; half of it acts on each frame."""

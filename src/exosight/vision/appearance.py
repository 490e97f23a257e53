"""How far finished pictures may differ; `exosight.vision.augment` draws and makes what becomes of each."""

from typing import Annotated

from pydantic import AfterValidator, Field
from pydantic.dataclasses import dataclass

from exosight.validation import CONFIG, rising
from exosight.vision.background import BACKGROUNDS, Background
from exosight.vision.occlusion import OCCLUSIONS, Occlusion

Share = Annotated[float, Field(ge=0.0, le=1.0)]
Fingers = Annotated[int, Field(ge=0, le=4)]


@dataclass(frozen=True, config=CONFIG)
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

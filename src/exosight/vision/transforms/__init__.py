"""What may become of a picture: one class a transform, each with its columns, its draw and its application.

base          what a transform is, what it draws from, and the canvas that it changes
composition   camera, bodies, and what is behind them
foreground    what hides the bodies
optics        light, lens and sensor

A further transform is a further class, last in `TRANSFORMS`: the columns of the others keep their draws.
"""

from exosight.vision.transforms.base import Transform
from exosight.vision.transforms.composition import Backdrop, BodyContrast, FingersBehind, View
from exosight.vision.transforms.foreground import FingersInFront, Occluder
from exosight.vision.transforms.optics import Blur, Exposure, Illumination, MotionBlur

TRANSFORMS: tuple[Transform, ...] = (
    View(),
    BodyContrast(),
    Backdrop(),
    FingersBehind(),
    FingersInFront(),
    Occluder(),
    Illumination(),
    Blur(),
    MotionBlur(),
    Exposure(),
)
"""In the order in which they are applied, and in which their columns are drawn."""

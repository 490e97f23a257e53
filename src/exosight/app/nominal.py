"""The system that a command of control drives: the published one, or that of a file."""

from exosight.app.pipeline import camera_of
from exosight.control import OnnxEstimator
from exosight.control.views import Views, cameras_of, check_fits
from exosight.errors import InputError
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.published import PublishedDesigns
from exosight.system.camera import Camera
from exosight.system.designs import DesignSet, FileDesigns
from exosight.system.schema import difference
from exosight.system.system import System


def nominal_system(
    designs: DesignSet, exosuit: Exosuit, estimator: OnnxEstimator | Views | None = None
) -> System:
    """The system without any variation.

    exosuit     the one that is worn, of the published system
    estimator   the published system has the camera that it was trained with

    Raises InputError for a set of designs that has no nominal one, or an estimator of another system.
    """
    if isinstance(designs, FileDesigns):
        system = designs.build(designs.nominal())
    elif isinstance(designs, PublishedDesigns):
        system = designs.preset(exosuit, camera_for(designs, estimator and cameras_of(estimator)[0]))
    else:
        raise InputError(f"system: {designs.name} has no nominal design; choose another, or a system file")
    if estimator is not None:
        check_fits(estimator, system.schema, "system")
    return system


def camera_for(designs: PublishedDesigns, estimator: OnnxEstimator | None) -> Camera:
    """The camera of the network's images; the nominal one without a network, or with one of another
    system."""
    if estimator is None or difference(estimator.card.schema, designs.schema, ("sensors",)):
        return designs.camera
    return camera_of(estimator.card)

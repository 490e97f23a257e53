"""Force control: the loop between a plant and an estimator.

plant       what a controller can actuate and look at
simulated   that plant as a simulation (its module alone needs JAX: `exosight.control.simulated`)
estimator   contact forces from images
laws        from target and measured force to the next actuation
loop        measure, ask the law, actuate, step after step
responses   settling, overshoot, steady-state error
trials      the paper's three constant targets and three step responses
"""

from exosight.control.estimator import Estimator, OnnxEstimator
from exosight.control.laws import Law, Proportional
from exosight.control.loop import Measure, Record, from_image, hold, hold_and_release, run, true_force
from exosight.control.plant import Observation, Plant
from exosight.control.responses import Response, judge_response
from exosight.control.trials import CONTROL_SHAPE, ControllerStudy, Trial, study

__all__ = [
    "CONTROL_SHAPE",
    "ControllerStudy",
    "Estimator",
    "Law",
    "Measure",
    "Observation",
    "OnnxEstimator",
    "Plant",
    "Proportional",
    "Record",
    "Response",
    "Trial",
    "from_image",
    "hold",
    "hold_and_release",
    "judge_response",
    "run",
    "study",
    "true_force",
]

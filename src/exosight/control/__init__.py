"""Force control: the loop between a plant and an estimator.

plant             what a controller actuates and observes
simulated         that plant as a simulation (needs JAX: `exosight.control.simulated`)
estimator         contact forces from images
trust             whether one of them is to be trusted, in words
calibration       a network corrected by its errors on one system (needs JAX: `exosight.control.calibration`)
batch             many simulated plants side by side (needs JAX: `exosight.control.batch`)
frame_history     inputs of a network beside the next image: earlier ones, u
laws              from target and measured force to the next actuation
loop              measure, evaluate the law, actuate, step after step
paths             the model of a plant that a controller has: paths of readings up and down, limits
scheduled         a law with the gains of those paths, and limits on actuation and on every contact
tuning            those paths from a simulation (needs JAX: `exosight.control.tuning`)
guard             a state machine that checks every frame: normal, slow, hold, release
at_rest           a controller that drives nothing, for pictures alone (needs JAX)
guarded           the loop with that law and guard in it, or with the adaptive controller
frame_check       what was measured in a step, and whether it can be used
observer          what a plant does that is not the one that was solved
adaptive          a controller that follows its observer, with authority by what it knows
learned           that controller with a learned correction of its command
policy_file       such a correction as an ONNX file
sources           frames of a camera, a video, a folder of pictures
actuators         what carries the command to the plant
realtime          the guarded loop at a fixed rate, which always ends at u = 0
simulated_device  a simulated plant in the place of camera and actuator (needs JAX)
recording         such a run as one file, and its frames through network and guard again
mcap              that file for viewers of ROS 2 messages
responses         settling, overshoot, steady-state error
trials            the paper's three constant targets and three step responses
stress            many random episodes in which much goes wrong
"""

from exosight.control.adaptive import Adaptive, AdaptiveConfig, AuthorityConfig
from exosight.control.estimator import Estimator, OnnxEstimator, Reader
from exosight.control.guard import GuardConfig, Guarded, Measurement, State, Transition
from exosight.control.guarded import Sense, guarded_of, measurement_from, run_guarded, true_measurement
from exosight.control.laws import Law, OpenLoop, Proportional
from exosight.control.loop import Measure, Record, from_image, hold, hold_and_release, run, true_reading
from exosight.control.observer import Observer, ObserverConfig
from exosight.control.paths import ControllerConfig, ForcePath
from exosight.control.plant import Observation, Plant
from exosight.control.responses import Response, measure_response
from exosight.control.scheduled import Scheduled
from exosight.control.trials import (
    CONTROL_SHAPE,
    Trial,
    published_trials,
    run_guarded_trials,
    run_trials,
)

__all__ = [
    "CONTROL_SHAPE",
    "Adaptive",
    "AdaptiveConfig",
    "AuthorityConfig",
    "ControllerConfig",
    "Estimator",
    "ForcePath",
    "GuardConfig",
    "Guarded",
    "Law",
    "Measure",
    "Measurement",
    "Observation",
    "Observer",
    "ObserverConfig",
    "OnnxEstimator",
    "OpenLoop",
    "Plant",
    "Proportional",
    "Reader",
    "Record",
    "Response",
    "Scheduled",
    "Sense",
    "State",
    "Transition",
    "Trial",
    "from_image",
    "guarded_of",
    "hold",
    "hold_and_release",
    "measure_response",
    "measurement_from",
    "published_trials",
    "run",
    "run_guarded",
    "run_guarded_trials",
    "run_trials",
    "true_measurement",
    "true_reading",
]

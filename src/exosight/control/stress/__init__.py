"""The controllers under stress: many random episodes, all of them stepped side by side.

config     what may go wrong, and how often
plants     which systems the episodes are about, and by how much they differ
episodes   what happens in an episode: target, user, system, camera, lost and corrupted frames
frames     frames that reach a controller: late, lost, repeated, noisy or occluded
suite      all episodes of one controller in closed loop
oracle     the same of the best commands there are
measures   settling, overshoot, errors, limits, release, from what was recorded

All but the first need JAX.
"""

from exosight.control.stress.config import KINDS, ControllerName, Kind, StressConfig

__all__ = ["KINDS", "ControllerName", "Kind", "StressConfig"]

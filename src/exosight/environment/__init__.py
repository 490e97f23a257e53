"""The grip as a Gymnasium environment: press as hard as asked, one system or many at a time.

    import gymnasium
    import exosight.environment

    env = gymnasium.make("exosight/Grip-v0")
    many = gymnasium.make_vec("exosight/Grip-v0", num_envs=64)

task    what is asked of an agent and what it is paid; the same for one grip and for many (needs JAX)
envs    the two classes that are registered with Gymnasium
disturbed  the same in the episodes of the stress test: a correction of the adaptive controller's command
"""

from exosight.errors import InputError

try:
    import gymnasium
except ModuleNotFoundError as error:
    raise InputError(
        "exosight.environment needs gymnasium, which is not installed: pip install 'exosight[gym]'"
    ) from error

GRIP = "exosight/Grip-v0"
"""Name by which `gymnasium.make` and `gymnasium.make_vec` know the environment."""

gymnasium.register(
    GRIP,
    entry_point="exosight.environment.envs:GripEnv",
    vector_entry_point="exosight.environment.envs:GripVectorEnv",
)

DISTURBED_GRIP = "exosight/DisturbedGrip-v0"
"""The same under the disturbances of the stress test."""

gymnasium.register(
    DISTURBED_GRIP,
    entry_point="exosight.environment.disturbed:DisturbedGripEnv",
    vector_entry_point="exosight.environment.disturbed:DisturbedGripVectorEnv",
)

__all__ = ["DISTURBED_GRIP", "GRIP"]

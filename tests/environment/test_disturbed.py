"""The grip under disturbances as Gymnasium sees it: its checks, one beside many, episodes, pay."""

import warnings
from typing import Any

import numpy as np
import pytest
from toy import controller

gymnasium = pytest.importorskip("gymnasium", reason="needs the extra gym")

from gymnasium.utils.env_checker import check_env  # noqa: E402

from exosight.control import CONTROL_SHAPE  # noqa: E402
from exosight.control.learned import INPUTS  # noqa: E402
from exosight.control.stress.plants import StressPlants  # noqa: E402
from exosight.environment import DISTURBED_GRIP  # noqa: E402
from exosight.environment.disturbed import DisturbedGripEnv, DisturbedGripVectorEnv  # noqa: E402
from exosight.environment.task import REWARD_UNIT  # noqa: E402
from exosight.errors import InputError  # noqa: E402
from exosight.exosuit.assembly import Exosuit  # noqa: E402
from exosight.exosuit.published import published  # noqa: E402
from exosight.system.camera import Camera  # noqa: E402

COUNT = 3  # as many as in the other environments, so that they share their compiled code
SHORT: dict[str, Any] = {"hold_seconds": 1.5, "release_seconds": 1.1}
STEPS = 25  # actions of an episode; before the first the plant is at rest


@pytest.fixture(scope="module")
def plants() -> StressPlants:
    """The published system with a small camera; its controller takes the path for a straight one."""
    nominal = published(Exosuit(CONTROL_SHAPE), Camera(metres_per_pixel=0.0088, width=16, height=16))
    limits = controller(schema=nominal.schema)
    return StressPlants(limits, nominal, lambda seed, number: nominal, (0.1, 0.3), (0.2, 0.3), 5.0)


@pytest.fixture(scope="module")
def many(plants: StressPlants) -> DisturbedGripVectorEnv:
    return DisturbedGripVectorEnv(COUNT, plants, **SHORT)


def constant(action: float) -> np.ndarray:
    return np.full((COUNT, 1), action, np.float32)


@pytest.mark.parametrize("observation", ["history", "state", "image", "mixed"])
def test_gymnasium_finds_nothing_wrong(plants: StressPlants, observation: str) -> None:
    env = gymnasium.make(
        DISTURBED_GRIP, system=plants, observation=observation, disable_env_checker=True, **SHORT
    )
    with warnings.catch_warnings():
        # A picture of 16 × 16 pixels is small on purpose; a newton is a newton, and is not scaled to ±1.
        warnings.filterwarnings("ignore", message=".*(Box|spec).*")
        check_env(env.unwrapped, skip_render_check=True)


def test_one_of_many_is_the_same_as_one(plants: StressPlants, many: DisturbedGripVectorEnv) -> None:
    one = DisturbedGripEnv(plants, **SHORT)
    actions = np.random.default_rng(0).uniform(-1, 1, (6, COUNT, 1)).astype(np.float32)
    rows = [(many.reset(seed=5)[0], np.zeros(COUNT))]
    for action in actions:
        seen, rewards, *_ = many.step(action)
        rows.append((seen, rewards))
    assert rows[0][0].shape == (COUNT, len(INPUTS))
    alone, _ = one.reset(seed=6)
    np.testing.assert_allclose(rows[0][0][1], alone, atol=1e-6)
    for k, action in enumerate(actions[:, 1]):
        alone, reward, *_ = one.step(action)
        # Solved to 1e-10 of the pose, in company or alone; the inputs are float32.
        np.testing.assert_allclose(rows[k + 1][0][1], alone, atol=1e-5)
        assert reward == pytest.approx(rows[k + 1][1][1], abs=1e-5)


def test_the_action_corrects_the_command_within_its_bound(plants: StressPlants) -> None:
    calm = {"latency": (0, 0), "dropped": (0, 0), "repeated": (0, 0), "bursts": 0, "moving_user": False}
    env = DisturbedGripVectorEnv(COUNT, plants, largest_correction=0.05, **calm, **SHORT)
    ends = []
    for action in (0.0, 1.0, 7.0):
        env.reset(seed=3)
        # The first command is what the law asks for from rest: the target is less than a step away.
        ends.append(env.step(constant(action))[4]["u"])
    np.testing.assert_allclose(ends[1], np.minimum(ends[0] + 0.05 * 4.0, 1.0), atol=1e-9)
    np.testing.assert_array_equal(ends[2], ends[1])


def test_the_pay_is_the_error_of_the_target_that_was_seen(many: DisturbedGripVectorEnv) -> None:
    _, told = many.reset(seed=1)
    for _ in range(4):
        target = told["target"]
        _, rewards, _, _, told = many.step(constant(0.0))
        np.testing.assert_allclose(rewards, -np.abs(target - told["F_net"]) / REWARD_UNIT, atol=1e-9)


def test_episodes_end_together_and_begin_anew(plants: StressPlants, many: DisturbedGripVectorEnv) -> None:
    many.reset(seed=1)
    for k in range(STEPS):
        _, _, terminated, truncated, told = many.step(constant(0.0))
        assert not terminated.any()
        assert truncated.all() == truncated.any() == (k == STEPS - 1)
    assert told["F_net"].max() < 0.05  # released by then
    _, rewards, _, truncated, told = many.step(constant(1.0))  # is not acted on
    assert not truncated.any()
    assert (rewards == 0).all()
    assert (told["u"] == 0).all()
    at_once = DisturbedGripVectorEnv(COUNT, plants, autoreset_mode="SameStep", **SHORT)
    at_once.reset(seed=1)
    for _ in range(STEPS):
        seen, _, _, truncated, told = at_once.step(constant(0.0))
    assert truncated.all()
    assert (told["u"] == 0).all()
    assert told["final_obs"][0].shape == seen[0].shape
    assert told["final_info"]["u"].shape == (COUNT,)


def test_the_last_picture_that_came_is_observed(plants: StressPlants) -> None:
    lost = DisturbedGripVectorEnv(COUNT, plants, observation="mixed", dropped=(1, 1), **SHORT)
    seen, _ = lost.reset(seed=0)
    assert not seen["image"].any()  # none has come
    clear = {"dropped": (0, 0), "repeated": (0, 0), "bursts": 0, "latency": (0, 0), "wrong_camera": False}
    env = DisturbedGripVectorEnv(COUNT, plants, observation="image", **clear, **SHORT)
    seen, _ = env.reset(seed=0)
    np.testing.assert_array_equal(seen["image"][0, :, :, 0], env._run.plant.pictures()[0])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"num_envs": 0}, "num_envs"),
        ({"observation": "all"}, "observation"),
        ({"latency": (0.3, 0.1)}, "lower limit first"),
        ({"system": "nothing"}, "nothing"),
    ],
)
def test_wrong_settings_end_in_one_sentence(plants: StressPlants, arguments: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        DisturbedGripVectorEnv(**{"num_envs": 1, "system": plants, **SHORT, **arguments})


def test_wrong_calls_end_in_one_sentence(plants: StressPlants, many: DisturbedGripVectorEnv) -> None:
    with pytest.raises(InputError, match="reset first"):
        DisturbedGripVectorEnv(1, plants, **SHORT).step(np.zeros((1, 1)))
    many.reset(seed=0)
    for wrong in (np.zeros(COUNT), constant(np.nan)):
        with pytest.raises(InputError, match="actions"):
            many.step(wrong)
    with pytest.raises(InputError, match="reset_mask"):
        many.reset(options={"reset_mask": np.array([True, False, False])})
    with pytest.raises(InputError, match="seed"):
        many.reset(seed=[1, 2])

"""The grip as Gymnasium sees it: its checks, one beside many, episodes that begin anew, limits and pay."""

import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from example_systems import THUMB, coarse_thumb

gymnasium = pytest.importorskip("gymnasium", reason="needs the extra gym")

from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium.vector import AutoresetMode  # noqa: E402

from exosight.environment import GRIP  # noqa: E402
from exosight.environment.envs import GripEnv, GripVectorEnv  # noqa: E402
from exosight.environment.task import REWARD_UNIT  # noqa: E402
from exosight.errors import InputError  # noqa: E402
from exosight.system.camera import Camera  # noqa: E402

SMALL = Camera(metres_per_pixel=0.0088, width=16, height=16)
COUNT = 3
SINGLE = 1e-6  # observations are float32: newtons of order 1 to seven digits


@pytest.fixture(scope="module")
def one() -> GripEnv:
    return GripEnv(steps=6, hold=2)


@pytest.fixture(scope="module")
def many() -> GripVectorEnv:
    return GripVectorEnv(COUNT, steps=6, hold=2)


def constant(action: float) -> np.ndarray:
    return np.full((COUNT, 1), action, np.float32)


@pytest.mark.parametrize("observation", ["state", "image", "mixed"])
def test_gymnasium_finds_nothing_wrong(observation: str) -> None:
    env = gymnasium.make(
        GRIP,
        observation=observation,
        steps=4,
        camera=SMALL,
        render_mode="rgb_array",
        disable_env_checker=True,
    )
    with warnings.catch_warnings():
        # A picture of 16 × 16 pixels is small on purpose; a newton is a newton, and is not scaled to ±1.
        warnings.filterwarnings("ignore", message=".*(Box|spec).*")
        check_env(env.unwrapped, skip_render_check=False)


def test_one_of_many_is_the_same_as_one(one: GripEnv, many: GripVectorEnv) -> None:
    rng = np.random.default_rng(0)
    actions = rng.uniform(-0.5, 1, (6, COUNT, 1)).astype(np.float32)
    seen, _ = many.reset(seed=5)
    rows = [(seen, None, None)]
    for action in actions:
        seen, reward, _, truncated, _ = many.step(action)
        rows.append((seen, reward, truncated))
    for i in range(COUNT):
        alone, _ = one.reset(seed=5 + i)
        np.testing.assert_allclose(rows[0][0][i], alone, atol=SINGLE)
        for k, action in enumerate(actions[:, i]):
            alone, reward, terminated, truncated, _ = one.step(action)
            seen, rewards, cut = rows[k + 1]
            # Solved to 1e-7 of the pose, in company or alone.
            np.testing.assert_allclose(seen[i], alone, atol=1e-5)
            assert reward == pytest.approx(rewards[i], abs=1e-4)
            assert (terminated, truncated) == (False, cut[i])


def test_the_pay_is_the_error_and_the_excess(one: GripEnv) -> None:
    env = GripEnv(steps=6, contact_limit=0.02, excess_weight=3.0)
    env.reset(options={"target": 0.2})
    for _ in range(4):
        seen, reward, *_ = env.step([0.8])
    forces = seen[2:]
    assert forces.sum() > 0.05
    excess = np.maximum(forces - 0.02, 0).sum()
    assert excess > 0
    assert reward == pytest.approx(-(abs(0.2 - forces.sum()) + 3 * excess) / REWARD_UNIT, abs=1e-4)


def test_u_keeps_its_limits(many: GripVectorEnv) -> None:
    many.reset(seed=0)
    _, _, _, _, told = many.step(np.array([[1.0], [7.0], [-1.0]], np.float32))
    np.testing.assert_allclose(told["u"], [1.0, 1.0, -1.0], atol=SINGLE)  # 7 is clipped to 1
    for _ in range(5):
        _, _, _, _, told = many.step(constant(1.0))
    np.testing.assert_allclose(told["u"], [4.0, 4.0, 4.0], atol=SINGLE)


def test_targets_are_drawn_or_told(one: GripEnv) -> None:
    drawn = [one.reset(seed=seed)[0][0] for seed in range(40)]
    assert min(drawn) == 0  # one in five asks to let go
    pressing = [target for target in drawn if target > 0]
    assert 0.10 <= min(pressing) < max(pressing) <= 0.35
    seen, _ = one.reset(options={"target": [0.3, 0.1]})
    shown = [seen[0]]
    for _ in range(3):
        shown.append(one.step([0.0])[0][0])
    assert shown == pytest.approx([0.3, 0.1, 0.1, 0.1], abs=SINGLE)
    with pytest.raises(InputError, match="target"):
        one.reset(options={"target": -0.1})
    with pytest.raises(InputError, match="target"):
        one.reset(options={"target": float("nan")})


def test_the_reward_is_for_the_target_that_was_seen(one: GripEnv) -> None:
    one.reset(options={"target": [0.3, 0.0]})
    _, first, *_ = one.step([0.0])
    _, second, *_ = one.step([0.0])
    assert first == pytest.approx(-0.3 / REWARD_UNIT)  # at rest nothing presses
    assert second == pytest.approx(0.0)


# Episodes


def test_next_step_begins_anew_one_step_later(many: GripVectorEnv) -> None:
    many.reset(seed=1)
    for _ in range(6):
        seen, _, terminated, truncated, _ = many.step(constant(0.5))
    assert truncated.all()
    assert not terminated.any()
    assert seen[:, 1] == pytest.approx(3.0)
    seen, reward, _, truncated, told = many.step(constant(1.0))  # is not acted on
    assert not truncated.any()
    assert (reward == 0).all()
    assert (told["u"] == 0).all()
    assert (seen[:, 1] == 0).all()
    for _ in range(5):
        assert not many.step(constant(0.5))[3].any()
    assert many.step(constant(0.5))[3].all()


def test_same_step_begins_anew_at_once_and_hands_over_the_last() -> None:
    env = GripVectorEnv(COUNT, steps=2, autoreset_mode=AutoresetMode.SAME_STEP)
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    env.reset(seed=1)
    env.step(constant(0.5))
    seen, reward, _, truncated, told = env.step(constant(0.5))
    assert truncated.all()
    assert (seen[:, 1] == 0).all()
    assert (reward < 0).any()
    assert [last[1] for last in told["final_obs"]] == pytest.approx([1.0] * COUNT)
    assert told["final_info"]["u"] == pytest.approx([1.0] * COUNT)
    assert not env.step(constant(0.5))[3].any()


def test_disabled_waits_to_be_reset() -> None:
    env = GripVectorEnv(COUNT, steps=1, autoreset_mode="Disabled")
    env.reset(seed=1)
    assert env.step(constant(0.5))[3].all()
    with pytest.raises(InputError, match="episode is over"):
        env.step(constant(0.5))
    seen, _ = env.reset(options={"reset_mask": np.array([True, False, False])})
    assert seen[:, 1] == pytest.approx([0.0, 0.5, 0.5])
    with pytest.raises(InputError, match="episode is over"):
        env.step(constant(0.5))
    env.reset(options={"reset_mask": np.array([False, True, True])})
    env.step(constant(0.5))


def test_gymnasium_makes_many() -> None:
    env = gymnasium.make_vec(GRIP, num_envs=COUNT, observation="mixed", camera=SMALL, render_mode="rgb_array")
    seen, told = env.reset(seed=0)
    assert env.observation_space.contains(seen)
    assert seen["image"].shape == (COUNT, 16, 16, 1)
    seen, *_ = env.step(env.action_space.sample())
    assert env.observation_space.contains(seen)
    frames = env.render()
    assert len(frames) == COUNT
    np.testing.assert_array_equal(frames[1][..., 2], seen["image"][1, ..., 0])
    assert told["_F_net"].all()


def test_the_code_of_the_page_runs() -> None:
    page = (Path(__file__).parents[2] / "docs" / "gymnasium.md").read_text()
    code = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)[0]
    assert "num_envs=64" in code
    names: dict[str, Any] = {}
    exec(compile(code.replace("num_envs=64", f"num_envs={COUNT}"), "gymnasium.md", "exec"), names)
    assert names["rewards"].shape == (COUNT,)
    assert set(names["env"].observation_space.spaces) == {"image", "state"}


# Systems of a user's own


def test_a_system_file_has_spaces_of_its_own_and_is_paid_by_the_same_rule() -> None:
    env = GripEnv(str(THUMB), sensor="P3", steps=5, contact_limit=0.02)
    seen, told = env.reset(options={"target": 0.3})
    assert env.observation_space.shape == (1 + 1 + 3,)  # target, channel u, P1 … P3
    assert set(told) == {"P3", "u", "converged"}
    for _ in range(3):
        seen, reward, *_, told = env.step([1.0])
        assert env.observation_space.contains(seen)
    excess = np.maximum(seen[2:] - 0.02, 0).sum()
    assert told["P3"] == pytest.approx(seen[4], abs=SINGLE)
    assert reward == pytest.approx(-(abs(0.3 - seen[4]) + 5 * excess) / REWARD_UNIT, abs=1e-4)


def test_a_preset_by_name_has_its_own_contacts_and_pictures() -> None:
    env, spheres = (
        GripEnv(system=name, observation="mixed", steps=2, camera=SMALL) for name in ("index", "published")
    )
    env.reset(seed=0, options={"target": 0.2})
    seen, reward, _, _, info = env.step([1.0])
    assert info["u"] == 1.0
    assert info["converged"]
    assert info["F_net"] == pytest.approx(seen["state"][2:].sum(), abs=SINGLE)
    assert reward == pytest.approx(-abs(0.2 - info["F_net"]) / REWARD_UNIT, abs=1e-3)
    spheres.reset(seed=0, options={"target": 0.2})
    other = spheres.step([1.0])[0]
    assert np.abs(other["state"] - seen["state"]).max() > 1e-3
    assert (other["image"] != seen["image"]).any()


def test_every_channel_has_an_action_within_its_own_range(tmp_path: Path) -> None:
    motor = """
[actuators.torque]
type = "joint_torque"
body = "proximal"
range = ["-20 mN m", "40 mN m"]
rate = "100 mN m/s"
"""
    file = tmp_path / "two.toml"
    file.write_text(coarse_thumb() + motor)
    env = GripEnv(str(file), steps=20)
    assert env.action_space.shape == (2,)
    env.reset(options={"target": 0.1})
    *_, told = env.step([0.0, 1.0])
    assert (told["u"], told["torque"]) == (0.0, pytest.approx(0.01))  # 100 mN m/s for 0.1 s
    for _ in range(6):
        *_, told = env.step([-1.0, 1.0])
    assert told["u"] == pytest.approx(-1.0)  # a quarter of its peak
    assert told["torque"] == pytest.approx(0.04)
    with pytest.raises(InputError, match="has 2 channels"):
        GripEnv(str(file), u_max=1.0)


# What is refused


@pytest.mark.parametrize(
    "settings",
    [
        {"observation": "sound"},
        {"steps": 0},
        {"rate": float("nan")},
        {"u_max": 9.0},
        {"system": "no_such_system"},
        {"sensor": "C9"},
        {"smallest_target": 0.4},
        {"render_mode": "human"},
        {"no_such_thing": 1},
    ],
)
def test_settings_out_of_range_are_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        GripEnv(**settings)


@pytest.mark.parametrize("action", [np.nan, np.inf, [0.1, 0.2]])
def test_actions_that_are_no_numbers_are_refused(one: GripEnv, action: Any) -> None:
    one.reset(seed=0)
    with pytest.raises(InputError, match="actions"):
        one.step(action)


def test_seeds_and_masks_of_another_number_are_refused(many: GripVectorEnv) -> None:
    with pytest.raises(InputError, match="seed"):
        many.reset(seed=[1, 2])
    with pytest.raises(InputError, match="reset_mask"):
        many.reset(options={"reset_mask": np.zeros(COUNT, bool)})
    with pytest.raises(InputError, match="num_envs"):
        GripVectorEnv(0)

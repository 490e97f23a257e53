"""docs/control.md and docs/stress.md show the numbers of docs/results, and conclude what these say."""

import json
from pathlib import Path
from typing import Any

import figures_control as control
import figures_stress as stress
import pytest

DOCS = Path(__file__).parents[1] / "docs"
TARGETS = ("0.25 N", "0.30 N", "0.35 N")


@pytest.fixture(scope="module")
def runs() -> dict[str, Any]:
    return control.load()


@pytest.fixture(scope="module")
def episodes() -> dict[str, Any]:
    return stress.load()


def test_their_pictures_can_be_drawn_and_are_there(runs, episodes):
    assert len(control.constant(runs["constant"]).axes) == 8
    assert len(control.steps(runs["step"]).axes) == 8
    assert len(stress.picture(episodes).axes) == 4
    for name in ("control_constant", "control_step", "stress"):
        assert (DOCS / "images" / f"{name}.png").stat().st_size > 10_000


@pytest.mark.parametrize("sensor", ["OURS", "OURS_IMAGE", "OURS_OWN"])
def test_the_guarded_controller_settles_in_six_steps_within_two_percent(runs, sensor):
    for name in TARGETS:
        trace = runs["constant"][getattr(control, sensor)][name]
        assert trace["settling_steps"] <= 6
        assert abs(trace["steady_state_error"]) < 0.02 * trace["target"][0]
        assert trace["log"] == []
        # 0.30 N lies in the jump up, of which the far side is 19 % above it.
        assert trace["overshoot_percent"] < (22 if name == "0.30 N" else 5)
    jump = max(runs["jumps"]["up"], key=lambda jump: jump["after"] - jump["before"])
    assert jump["before"] < 0.30 < 1.19 * 0.30 < jump["after"]


def test_the_papers_law_settles_as_fast_as_the_papers_once_the_network_is_calibrated(runs):
    for name, steps in control.PAPER.items():
        trace = runs["constant"][control.LAW_OWN][name]
        assert trace["settling_steps"] <= steps
        assert abs(trace["steady_state_error"]) < 0.02 * trace["target"][0]
    assert runs["constant"][control.LAW_IMAGE]["0.30 N"]["settling_steps"] is None


def test_a_dropped_target_is_let_go_within_a_second_and_a_gain_of_100_leaves_the_range(runs):
    for name in (control.OURS, control.OURS_IMAGE, control.OURS_OWN):
        assert runs["step"][name][""]["seconds_to_5_mN"] <= 1.0
    wild = runs["step"][control.LAW]["100"]
    assert (wild["largest_u"], wild["smallest_u"]) == (6.0, -6.0)
    assert wild["overshoot_percent"] > 100


def test_no_episode_is_unrecovered_late_or_commanded_beyond_limits(episodes):
    for name in ("stress", "stress_true", "stress_latency"):
        assert episodes[name]["about"]["episodes"] == 1000
        found = episodes[name]["controllers"]["guarded"]
        for count in ("unrecovered", "released_late", "commands_outside"):
            assert found[count] == 0
    assert episodes["stress_latency"]["controllers"]["guarded"]["outside_contact_limit"] == 0
    assert episodes["stress_paper"]["controllers"]["K_P = 5"]["outside_contact_limit"] > 0


def test_the_adaptive_controller_attains_more_and_hardly_ever_gives_up(episodes):
    # Of 1,000 episodes, as the page says. The guarded controller gains from the network of the loop too.
    for name, beyond, ratio in (("stress_index_true", 1, 1.5), ("stress_index_image", 0, 1.4)):
        assert episodes[name]["about"]["episodes"] == 1000
        found = episodes[name]["controllers"]
        adaptive, guarded = found["adaptive"], found["guarded"]
        for each in (adaptive, guarded, found["oracle"]):
            for count in ("unrecovered", "released_late", "commands_outside"):
                assert each[count] == 0
        assert adaptive["outside_contact_limit"] <= beyond
        assert found["oracle"]["attained"] == adaptive["attainable"]
        assert adaptive["attained"] > ratio * guarded["attained"]
        assert adaptive["given_up"] < 0.1 * guarded["given_up"]


def test_with_late_and_lost_frames_alone_nearly_all_targets_are_attained(episodes):
    found = episodes["stress_index_latency"]["controllers"]["adaptive"]
    assert found["attained"] >= 0.95 * found["attainable"] > 300


def test_with_friction_creep_and_slow_actuators_hardly_any_release_is_late(episodes):
    for name, late, ratio in (("stress_index2_true", 1, 1.8), ("stress_index2_image", 2, 1.3)):
        assert episodes[name]["about"]["episodes"] == 1000
        adaptive, guarded = (episodes[name]["controllers"][kind] for kind in ("adaptive", "guarded"))
        assert adaptive["commands_outside"] == adaptive["unrecovered"] == adaptive["given_up"] == 0
        assert adaptive["released_late"] <= late
        assert adaptive["outside_contact_limit"] == 0
        assert adaptive["attained"] > ratio * guarded["attained"]


def test_what_frames_tell_bounds_the_adaptive_controller(episodes):
    """The bounds do not depend on the sensor, and with the true force the errors of a user who moves are
    those of one who is known as of the last frame.
    """
    for suite in ("stress_index", "stress_index2"):
        true, image = (episodes[f"{suite}_{sensor}"]["controllers"] for sensor in ("true", "image"))
        for bound in ("oracle", "delayed-oracle"):
            assert true[bound]["attained"] == image[bound]["attained"]
        for found in (true, image):
            assert found["adaptive"]["attained"] < found["delayed-oracle"]["attained"]
            assert found["delayed-oracle"]["attained"] < found["oracle"]["attained"]
    errors = {name: each["hold_error"] for name, each in episodes["stress_index_true"]["controllers"].items()}
    assert errors["adaptive"]["user moves"] < 1.05 * errors["delayed-oracle"]["user moves"]
    assert errors["delayed-oracle"]["user moves"] > 2 * errors["oracle"]["user moves"]


def test_of_very_many_episodes_none_is_late_unrecovered_or_commanded_beyond_limits():
    found = json.loads((DOCS / "results" / "many_episodes.json").read_text())
    for each in found["controllers"].values():
        assert each["episodes"] >= 100_000
        assert each["late"] == each["unrecovered"] == each["commands_outside"] == 0
        assert each["outside_contact_limit"] < 0.003 * each["episodes"]
    adaptive = found["controllers"]["adaptive"]
    assert adaptive["outside_contact_limit"] <= 1e-4 * adaptive["episodes"]

"""Figures of the closed loop."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from schemas import published_schema

from exosight.app.control_figures import steady_states, step_responses, trial_figures
from exosight.control import Record, Trial, measure_response


def run(target: float = 0.25, steps: int = 20, released: bool = False) -> Record:
    time = np.arange(steps) / 10
    force = target * (1 - np.exp(-3 * time))
    return Record(
        schema=published_schema(),
        sensor="F_net",
        channel="u",
        time=time,
        target=np.where(released & (time >= time.mean()), 0.0, target),
        true=force,
        estimated=force + 0.01,
        command=10 * force,
        images=np.zeros((steps, 8, 8), np.uint8),
        q=np.zeros((steps, 25)),
        converged=np.ones(steps, dtype=bool),
    )


def line(ax: Axes, label: str):
    return next(line for line in ax.get_lines() if line.get_label() == label)


def labels(figure: Figure) -> list[str]:
    return [text for ax in figure.axes for text in (ax.get_xlabel(), ax.get_ylabel()) if text]


def test_axes_name_quantity_and_unit():
    assert set(labels(steady_states([run(0.25), run(0.3)]))) == {"F_net [N]", "command u [N]", "time [s]"}
    steps = step_responses({"K_P = 0.1": run(), "K_P = 1": run()})
    assert set(labels(steps)) == {"F_net [N]", "error e [N]", "command u [N]", "time [s]"}


def test_trials_are_drawn_by_target_and_gain():
    def trial(gain: float, target: float, released: bool) -> Trial:
        record = run(target, released=released)
        response = measure_response(record.time, record.target, record.true, record.command, record.driven)
        return Trial(gain, record, response)

    assert set(trial_figures([trial(5.0, 0.3, False)])) == {"steady_states"}
    assert set(trial_figures([trial(1.0, 0.2, True), trial(5.0, 0.2, True)])) == {"step_responses"}
    names = set(trial_figures([trial(1.0, 0.2, True), trial(1.0, 0.3, True)]))
    assert names == {"step_responses_0.2", "step_responses_0.3"}


def test_steady_states_show_true_estimated_target_and_the_training_limit():
    shown = run(0.25)
    force, actuation = steady_states([shown]).axes
    target, true, estimated = force.get_lines()
    np.testing.assert_array_equal(true.get_ydata(), shown.true)
    np.testing.assert_array_equal(estimated.get_ydata(), shown.estimated)
    np.testing.assert_array_equal(target.get_ydata(), shown.target)
    np.testing.assert_array_equal(line(actuation, "target 0.25 N").get_ydata(), shown.command)
    assert any(set(drawn.get_ydata()) == {4.0} for drawn in actuation.get_lines())


def test_step_responses_draw_the_error_that_the_controller_sees():
    runs = {"K_P = 0.1": run(0.2), "K_P = 100": run(0.3)}
    _, error, actuation = step_responses(runs).axes
    for drawn, shown in zip(error.get_lines(), runs.values(), strict=True):
        np.testing.assert_allclose(drawn.get_ydata(), shown.target - shown.estimated)
    np.testing.assert_array_equal(line(actuation, "K_P = 100").get_ydata(), runs["K_P = 100"].command)

from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from schemas import mixed_schema, published_schema

from exosight.evaluation import figures
from exosight.evaluation.figures.learning import rate_drops
from exosight.evaluation.figures.motion import find_snaps
from exosight.evaluation.metrics import score
from exosight.evaluation.published import ROBUSTNESS_PUBLISHED
from exosight.system.schema import SensorSpec

SCHEMA = published_schema()
CONTACTS = SCHEMA.outputs


def forces(frames: int = 80) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    true = rng.gamma(1.0, 0.2, (frames, 7)) * (rng.random((frames, 7)) < 0.5)
    return true, (true + rng.normal(0, 0.01, true.shape)).astype(np.float32)


def images(count: int) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (count, 16, 16), dtype=np.uint8)


def labels(figure: Figure) -> str:
    texts = [figure.get_supxlabel(), figure.get_supylabel()]
    for ax in figure.axes:
        texts += [ax.get_xlabel(), ax.get_ylabel()]
    return " | ".join(text for text in texts if text)


def line(ax: Axes, label: str):
    return next(line for line in ax.get_lines() if line.get_label() == label)


def loss_figure() -> Figure:
    epochs = np.arange(1, 11)
    rates = np.where(epochs < 6, 2e-4, 2e-5)
    checks = epochs[4::5]
    return figures.loss_curves(epochs, 1 / epochs, checks, np.array([0.3, 0.25]), rates, "L1 loss [N]")


def overview() -> Figure:
    x = np.linspace(0, 0.1, 42)
    rod = np.column_stack([x, 0.02 - 3 * x**2])
    finger = np.column_stack([[0, 0.02, 0.045, 0.056, 0.07, 0.08, 0.0939, 0.0944], np.zeros(8)])
    true, estimated = np.arange(7) / 10, np.arange(7) / 11
    return figures.overview(
        figures.Outline(rod, np.full(42, 0.005)),
        figures.Outline(finger, np.linspace(0.01, 0.004, 8)),
        ["C0", *CONTACTS],
        images(1)[0],
        dict(zip(CONTACTS, zip(true.tolist(), estimated.tolist(), strict=True), strict=True)),
    )


def every_figure() -> dict[str, Figure]:
    true, estimated = forces()
    cases = {name: score(SCHEMA, true, estimated) for name in ROBUSTNESS_PUBLISHED}
    u = np.r_[0:4:5j, 3:0:4j]
    return {
        "overview": overview(),
        "loss": loss_figure(),
        "traces": figures.sample_traces(SCHEMA, true, estimated),
        "scatter": figures.predicted_against_true(SCHEMA, true, estimated),
        "rain": figures.rainclouds(SCHEMA, true, estimated),
        "corrupted": figures.corrupted_examples({name: images(2) for name in ROBUSTNESS_PUBLISHED}),
        "bars": figures.robustness_bars(cases),
        "path": figures.loading_path(u, u / 10, np.arange(len(u)) == 3),
        "poses": figures.pose_strip(images(3), ["t = 0 s", "t = 5 s", "t = 10 s"]),
    }


@pytest.fixture(scope="module")
def drawn() -> dict[str, Figure]:
    return every_figure()


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("overview", ["x [cm]", "z [cm]", "contact force [N]"]),
        ("loss", ["epoch", "L1 loss [N]", "learning rate"]),
        ("traces", [f"{name} [N]" for name in (*CONTACTS, "F_net")]),
        ("scatter", ["true force [N]", "estimated force [N]", "frames in a cell [-]"]),
        ("rain", ["force [N]"]),
        ("bars", ["RMSE [N]", "RMS% [% of range]", "Pearson r [-]"]),
        ("path", ["actuation u [N]", "F_net [N]"]),
    ],
)
def test_axes_say_quantity_and_unit(name, expected, drawn):
    text = labels(drawn[name])
    for label in expected:
        assert label in text


def test_process_wide_style_stays_as_it_was():
    before = dict(matplotlib.rcParams)
    figures.to_bytes(every_figure()["path"])
    assert dict(matplotlib.rcParams) == before


def test_svg_is_reproducible_and_holds_no_text_to_be_fetched():
    first, again = (figures.to_bytes(loss_figure()) for _ in range(2))
    assert first == again
    assert b"<text" not in first
    assert b"<image" not in first


def test_loss_curves_plot_what_they_are_given():
    figure = loss_figure()
    loss, rate = figure.axes
    np.testing.assert_array_equal(line(loss, "training").get_ydata(), 1 / np.arange(1, 11))
    checked = line(loss, "validation, best 0.25 in epoch 10")
    np.testing.assert_array_equal(checked.get_xdata(), [5, 10])
    assert rate.get_yscale() == "log"
    dotted = [drawn for drawn in rate.get_lines() if drawn.get_linestyle() == ":"]
    assert [drawn.get_xdata()[0] for drawn in dotted] == [6]


def test_loss_curves_without_validation_show_training_alone():
    epochs, nothing = np.arange(1, 4), np.array([], dtype=int)
    figure = figures.loss_curves(epochs, 1 / epochs, nothing, nothing * 1.0, np.full(3, 1e-3), "L1 loss [N]")
    assert [drawn.get_label() for drawn in figure.axes[0].get_lines()] == ["training"]


def test_rate_drops_are_steps_of_a_constant_rate_only():
    epochs = np.arange(1, 8)
    assert rate_drops(epochs, np.array([1, 1, 1, 0.1, 0.1, 0.01, 0.01])).tolist() == [4, 6]
    assert rate_drops(epochs, np.geomspace(1, 1e-3, 7)).tolist() == []


def test_traces_pair_true_and_estimated_of_the_same_frames():
    true, estimated = forces(30)
    estimated = (true + 100).astype(np.float32)  # so that a wrong pairing cannot go unseen
    figure = figures.sample_traces(SCHEMA, true, estimated, samples=10, seed=1)
    for contact, ax in enumerate(figure.axes):
        t, e = (drawn.get_ydata() for drawn in ax.get_lines())
        shift = 700 if ax.get_ylabel() == "F_net [N]" else 100
        np.testing.assert_allclose(e - t, shift, rtol=1e-5)  # float32 at 700 N
        if ax.get_ylabel() != "F_net [N]":
            column = CONTACTS.index(ax.get_ylabel().removesuffix(" [N]"))
            assert np.isin(t, true[:, column]).all(), contact
    assert len(figure.axes[0].get_lines()[0].get_ydata()) == 10


def test_fewer_frames_than_samples_are_all_drawn():
    true, estimated = forces(5)
    figure = figures.sample_traces(SCHEMA, true, estimated, samples=60)
    assert len(figure.axes[0].get_lines()[0].get_ydata()) == 5


def test_predicted_against_true_counts_every_frame_on_equal_axes():
    true, estimated = forces(80)
    figure = figures.predicted_against_true(SCHEMA, true, estimated)
    scores = score(SCHEMA, true, estimated)
    panels = [ax for ax in figure.axes if ax.get_title()]
    assert len(panels) == 8
    for ax, metrics in zip(panels, (*scores.outputs, *scores.sums), strict=True):
        assert ax.get_xlim() == ax.get_ylim()
        assert ax.get_aspect() == 1
        np.testing.assert_array_equal(line(ax, "identity").get_xdata(), line(ax, "identity").get_ydata())
        assert f"r = {metrics.r:.3f}" in ax.get_title()
        assert f"RMSE {metrics.rmse:.3f} N" in ax.get_title()
        assert ax.collections[0].get_array().sum() == 80


def test_contact_that_never_touches_is_drawn_without_a_correlation():
    true, estimated = forces()
    true[:, 0] = 0
    scatter = figures.predicted_against_true(SCHEMA, true, estimated)
    assert "C1: r = –" in scatter.axes[0].get_title()
    rain = figures.rainclouds(SCHEMA, true, estimated)
    assert rain.axes[0].get_title() == "C1: touching in 0 %"
    assert len(rain.axes[0].collections) == 0
    assert len(rain.axes[1].collections) == 2


def test_rainclouds_show_touching_frames_estimated_above_true_below():
    true, estimated = forces()
    estimated = (true + 5).astype(np.float32)
    ax = figures.rainclouds(SCHEMA, true, estimated).axes[2]
    touching = true[:, 2] >= 1e-3
    assert f"{100 * touching.mean():.0f} %" in ax.get_title()
    above, below = (cloud.get_paths()[0].vertices for cloud in ax.collections)
    assert above[:, 1].min() > 0 > below[:, 1].max()
    # The clouds end where the data end.
    assert below[:, 0].max() == pytest.approx(true[touching, 2].max())
    assert above[:, 0].min() == pytest.approx(true[touching, 2].min() + 5)


def test_raincloud_of_one_value_is_drawn():
    true = np.zeros((4, 7))
    true[0] = 0.1
    assert len(figures.rainclouds(SCHEMA, true, true.copy()).axes[0].collections) == 2


def test_bars_stand_beside_the_papers():
    true, estimated = forces()
    cases = {name: score(SCHEMA, true, estimated) for name in ("clean", "noise-high")}
    ax = figures.robustness_bars(cases).axes[2]
    ours, paper = ax.containers[1], ax.containers[3]
    assert [bar.get_height() for bar in ours] == [cases["clean"].r.mean] * 2
    assert [bar.get_height() for bar in paper] == [0.83, 0.11]
    assert [tick.get_text() for tick in ax.get_xticklabels()] == ["clean", "noise, high"]


def test_bars_of_a_negative_correlation_stay_inside_the_axis():
    true, _ = forces()
    ax = figures.robustness_bars({"clean": score(SCHEMA, true, 1 - true)}).axes[2]
    assert ax.get_ylim()[0] <= -0.99


def test_corrupted_examples_show_the_pixels_themselves():
    examples = {"clean": images(2), "noise-low": 255 - images(2)}
    figure = figures.corrupted_examples(examples)
    assert [ax.get_title() for ax in figure.axes] == ["clean", "noise, low", "", ""]
    shown = [ax.images[0] for ax in figure.axes]
    np.testing.assert_array_equal(shown[3].get_array(), examples["noise-low"][1])
    assert shown[3].get_clim() == (0, 255)


def test_loading_path_breaks_at_a_snap_and_bridges_it_with_dots():
    u, force = np.array([0.0, 1.0, 2.0, 1.0, 0.0]), np.array([0.0, 0.1, 0.5, 0.4, 0.0])
    snaps = np.array([False, False, True, False, True])
    (ax,) = figures.loading_path(u, force, snaps).axes
    np.testing.assert_array_equal(line(ax, "loading").get_ydata(), [0, 0.1, np.nan, 0.5])
    np.testing.assert_array_equal(line(ax, "unloading").get_ydata(), [0.5, 0.4, np.nan, 0])
    bridges = [drawn.get_ydata().tolist() for drawn in ax.get_lines() if drawn.get_linestyle() == ":"]
    assert bridges == [[0.1, 0.5], [0.4, 0.0]]


def test_snaps_are_jumps_far_beyond_their_neighbours():
    tip = np.column_stack([np.linspace(0.1, 0.08, 41), np.zeros(41)])  # half a millimetre a step
    assert not find_snaps(tip).any()
    tip[20:] -= 0.01
    assert np.flatnonzero(find_snaps(tip)).tolist() == [20]


def test_a_pose_at_rest_has_no_snaps():
    tip = np.zeros((10, 2))
    tip[5:] += 1e-6  # far beyond its neighbours, but no motion to speak of
    assert not find_snaps(tip).any()


def test_pose_strip_labels_every_image_and_wraps():
    figure = figures.pose_strip(images(8), [f"u = {i} N" for i in range(8)])
    shown = [ax for ax in figure.axes if ax.images]
    assert [ax.get_title() for ax in shown] == [f"u = {i} N" for i in range(8)]


def test_overview_names_the_parts_and_shows_the_forces_of_its_image():
    system, camera, answer = overview().axes
    words = {text.get_text() for text in system.texts}
    assert words >= {"finger", "soft exosuit", "line of actuation, u", "clamp", "C0", "C7"}
    np.testing.assert_array_equal(camera.images[0].get_array(), images(1)[0])
    true, estimated = answer.containers
    np.testing.assert_allclose([bar.get_width() for bar in true], np.arange(7) / 10)
    np.testing.assert_allclose([bar.get_width() for bar in estimated], np.arange(7) / 11)
    # The line of actuation lies on the side away from the finger.
    curve = next(drawn for drawn in system.get_lines() if len(drawn.get_xdata()) == 42)
    assert (curve.get_ydata() > 100 * (0.02 - 3 * np.linspace(0, 0.1, 42) ** 2)).all()


@pytest.mark.parametrize("count", [1, 2, 5, 23])
def test_any_number_of_sensors_has_a_panel_each(count: int):
    zones = tuple(SensorSpec(f"zone_{i}", "contact force", "N", estimated=True) for i in range(count))
    schema = replace(mixed_schema(), sensors=zones)
    true = np.random.default_rng(0).random((40, count))
    for figure in (
        figures.sample_traces(schema, true, true),
        figures.predicted_against_true(schema, true, true),
        figures.rainclouds(schema, true, true),
    ):
        shown = [ax for ax in figure.axes if ax.axison and (ax.get_title() or "zone" in ax.get_ylabel())]
        names = [(ax.get_title() or ax.get_ylabel()).replace(":", " ").split()[0] for ax in shown]
        assert sorted(names) == sorted(schema.outputs)
        figures.to_bytes(figure)


def test_figures_of_another_system_have_its_names_and_units_and_no_paper():
    schema = mixed_schema()
    true = np.random.default_rng(0).random((40, 4)) * [1, -1, 1, 1]
    traces = figures.sample_traces(schema, true, true + 0.1)
    assert [ax.get_ylabel() for ax in traces.axes if ax.axison] == [
        *("zone_0 [N]", "zone_2 [N]", "knuckle_of_\nthe_index [rad]", "grip [N]", "zone_1 [N]")
    ]
    scatter = figures.predicted_against_true(schema, true, true + 0.1)
    assert "RMSE 0.100 rad" in scatter.axes[1].get_title()
    assert figures.rainclouds(schema, true, true).axes[1].get_title() == "knuckle_of_\nthe_index: [rad]"
    bars = figures.robustness_bars({"clean": score(schema, true, true + 0.1)})
    assert "RMSE" not in labels(bars)  # newtons and radians have no mean
    assert [text.get_text() for text in bars.legends[0].get_texts()] == ["exosight"]


@pytest.mark.parametrize("points", [3, 200])
def test_curves_say_quantity_and_unit_and_differ_without_colour(points: int):
    x = np.linspace(0, 4, points)
    shown = tuple(figures.Curve(f"C{i}", x, i * x, x - 1, x + 1) for i in range(8))
    goal = figures.Curve("target", x, x, target=True)
    figure = figures.curves(
        "u [N]", [figures.Panel("force [N]", (*shown, goal)), figures.Panel("a [rad]", shown[:1])]
    )
    assert [ax.get_ylabel() for ax in figure.axes] == ["force [N]", "a [rad]"]
    assert figure.axes[-1].get_xlabel() == "u [N]"
    first, second = figure.axes
    np.testing.assert_array_equal(line(first, "C3").get_ydata(), 3 * x)
    looks = {(each.get_color(), each.get_marker(), each.get_linestyle()) for each in first.get_lines()}
    assert len(looks) == 9
    assert len({look[1:] for look in looks}) >= 4
    assert first.get_legend() is not None
    assert second.get_legend() is None


@pytest.mark.parametrize(("kind", "start"), [("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_figures_are_written_as_png_pdf_or_svg(kind: str, start: bytes):
    first, again = (figures.to_bytes(loss_figure(), kind) for _ in range(2))
    assert first.startswith(start)
    assert first == again


def test_panels_of_a_group_have_one_vertical_range():
    x = np.arange(3.0)
    panels = [figures.Panel(f"{k} [N]", (figures.Curve("", x, k * x),), group="N") for k in (1, 5)]
    figure = figures.curves("picture [-]", [*panels, figures.Panel("score [-]", panels[0].curves)], columns=2)
    small, large, score = (ax.get_ylim() for ax in figure.axes[:3])
    assert small == large
    assert small != score

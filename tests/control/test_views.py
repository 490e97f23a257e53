"""Several cameras: what is stacked returns, and what estimates and intervals become together."""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cards import made_up

from exosight.control.estimator import DEFAULT_MODEL, OnnxEstimator, Reading
from exosight.control.sources import Frame
from exosight.control.views import Views, fused, joined, split, stacked
from exosight.errors import InputError


def reading(values: list[float], half: float, score: float = 0.2) -> Reading:
    forces = np.array([values], np.float32)
    return Reading(forces, forces - half, forces + half, forces * 0, np.array([score], np.float32))


def both(*readings: Reading) -> Reading:
    return fused(readings, np.ones((len(readings), 1), bool), 0.9)


def test_stacked_views_are_split_again() -> None:
    views = [np.full((4, 6), 1, np.uint8), np.full((3, 5), 2, np.uint8)]
    picture = stacked(views)
    assert picture.shape == (7, 6)
    for view, again in zip(views, split(picture[None], [(4, 6), (3, 5)]), strict=True):
        np.testing.assert_array_equal(again[0], view)


def test_values_are_weighed_by_their_inverse_variance() -> None:
    found = both(reading([0.1, 0.0], 0.01), reading([0.13, 0.0], 0.02))
    # Weights 4 : 1 for intervals 1 : 2.
    np.testing.assert_allclose(found.forces, [[0.106, 0.0]], rtol=1e-6)
    np.testing.assert_allclose(found.high - found.forces, 0.012, rtol=1e-5)


def test_an_interval_holds_where_those_of_all_views_do() -> None:
    random = np.random.default_rng(0)
    half = random.uniform(0.01, 0.1, (3, 500, 4))
    values = half * random.uniform(-1, 1, half.shape)  # of a true value of 0: every interval holds it
    readings = [
        Reading(v, v - h, v + h, v, np.zeros(500, np.float32))
        for v, h in zip(values.astype(np.float32), half.astype(np.float32), strict=True)
    ]
    found = fused(readings, np.ones((3, 500), bool), 0.9)
    assert np.all(found.low <= 0)
    assert np.all(found.high >= 0)
    assert np.mean(found.forces**2) < np.mean(values**2, axis=(1, 2)).min()


def test_a_view_out_of_distribution_is_left_out_while_another_is_not() -> None:
    good, bad = reading([0.1], 0.01), reading([0.5], 0.001, score=3.0)
    found = both(good, bad)
    assert found.forces[0, 0] == good.forces[0, 0]
    assert found.ood_score[0] == good.ood_score[0]
    assert both(bad, bad).ood_score[0] == pytest.approx(3)
    hidden = fused((good, reading([0.5], 0.001)), np.array([[True], [False]]), 0.9)
    assert hidden.forces[0, 0] == good.forces[0, 0]


def test_views_that_disagree_are_not_trusted() -> None:
    assert both(reading([0.1], 0.01), reading([0.11], 0.01)).ood_score[0] < 1
    # Intervals of ± 1.64 σ that are nine σ of their difference apart.
    assert both(reading([0.1], 0.01), reading([0.18], 0.01)).ood_score[0] > 2.5


def pictures(count: int, shape: tuple[int, int], missing: tuple[int, ...] = ()) -> Iterator[Frame | None]:
    for i in range(count):
        yield None if i in missing else Frame(np.full(shape, 10 + i, np.uint8), float(i))


def test_sources_are_joined_until_one_ends() -> None:
    sizes = ((4, 6), (3, 5))
    found = list(joined([pictures(5, sizes[0], (1, 2)), pictures(4, sizes[1], (2,))], sizes))
    assert len(found) == 4
    assert found[2] is None
    assert found[1] is not None
    top, below = split(found[1].image[None], sizes)
    assert not top.any()
    assert (below == 11).all()
    assert found[1].time == 1


def test_a_frozen_view_counts_as_none() -> None:
    still = (Frame(np.full((4, 6), 9, np.uint8), time.monotonic()) for _ in range(6))
    found = list(joined([still, pictures(6, (4, 6))], ((4, 6), (4, 6)), frozen=3))
    assert [bool(frame and frame.image[:4].any()) for frame in found] == [True] * 3 + [False] * 3
    assert all(frame and frame.image[4:].all() for frame in found)


def test_networks_that_are_not_for_one_plant_are_refused() -> None:
    card = made_up(4, 6)
    fewer = replace(card.schema, sensors=card.schema.sensors[:3])
    other = OnnxEstimator(None, made_up(4, 6, schema=fewer))
    with pytest.raises(InputError, match="model 2: it is for other sensors"):
        Views((OnnxEstimator(None, card), other))
    with pytest.raises(InputError, match="two networks or more"):
        Views((other,))
    top = replace(card.schema, cameras=(replace(card.schema.cameras[0], name="top"),))
    views = Views((OnnxEstimator(None, card), OnnxEstimator(None, made_up(4, 6, schema=top))))
    views.check_fits(replace(card.schema, cameras=(*card.schema.cameras, *top.cameras)), "system")
    with pytest.raises(InputError, match="expected the cameras"):
        views.check_fits(card.schema, "system")


def test_one_view_twice_reads_as_once() -> None:
    network = OnnxEstimator.load(Path(DEFAULT_MODEL))
    images = np.random.default_rng(0).integers(0, 255, (2, 128, 128), np.uint8)
    alone = network.read(images)
    found = Views((network, network)).read(np.concatenate([images, images], axis=1))
    for name in ("forces", "low", "high", "contact", "ood_score"):
        # Single precision, weighed in double.
        np.testing.assert_allclose(getattr(found, name), getattr(alone, name), rtol=1e-5, atol=1e-6)
    with pytest.raises(InputError, match="256, 128"):
        Views((network, network)).read(images)

"""Masks of drawn bodies before textured scenes, against the bodies that were drawn."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy import ndimage

from exosight.app.main import main
from exosight.errors import DataError, InputError
from exosight.rig.identification.outlines import UNKNOWN, outline_of_mask
from exosight.rig.segmentation import Segmented, segment
from exosight.system.camera import Camera
from exosight.vision.background import background
from exosight.vision.renderer import Tube, render

CAMERA = Camera(centre=(0.0, 0.0), metres_per_pixel=0.0005, width=224, height=168)
FINGER = np.array([[-0.04, 0.0, -0.008], [0.0, 0.0, -0.012], [0.04, 0.0, -0.024]]), [0.011, 0.008, 0.005]
ROD = np.array([[-0.04, 0.0, 0.011], [0.0, 0.0, 0.006], [0.04, 0.0, 0.014]]), [0.007, 0.006, 0.005]
COLOURS = np.array([[225.0, 160.0, 130.0], [40.0, 60.0, 150.0]])


def drawn(shadow: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A picture, the empty scene, and the true mask; exposures differ by a tenth, noise is 2 grays."""
    random = np.random.default_rng(0)
    texture = background("fractal", (168, 224), 0.6, 0.2, 0.3, 0.4, seed=1).astype(float)
    scene = texture[..., None] * [1.0, 0.95, 0.8]
    picture, mask, total = scene.copy(), np.zeros((168, 224), np.uint8), np.zeros((168, 224))
    bodies = [Tube(centres[None], np.array([radii]), 1.0) for centres, radii in (FINGER, ROD)]
    covers = [1 - render([replace(tube, shade=0.0)], CAMERA)[0] / 235 for tube in bodies]
    for cover in covers:
        total = np.maximum(total, cover)
    cast = ndimage.gaussian_filter(np.roll(total, (9, 7), axis=(0, 1)), 3)
    picture *= 1 - shadow * cast[..., None]
    for number, (tube, cover) in enumerate(zip(bodies, covers, strict=True), 1):
        # The rim's light is that within: half covered pixels are mixed with what is behind by the cover.
        lit = np.where(cover > 0.99, render([tube], CAMERA)[0] / 255, 0)
        lit = np.where(cover > 0.99, lit, ndimage.maximum_filter(lit, 3))
        part = cover[..., None]
        picture = (1 - part) * picture + part * COLOURS[number - 1] * lit[..., None]
        mask[cover > 0.5] = number

    def taken(light: np.ndarray) -> np.ndarray:
        noisy = light + random.normal(scale=2, size=light.shape)
        return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)

    return taken(0.9 * picture), taken(scene), mask


def overlaps(found: Segmented, mask: np.ndarray) -> list[float]:
    """Intersection over union of each body."""
    pairs = [(found.mask == body, mask == body) for body in (1, 2)]
    return [float((own & true).sum() / (own | true).sum()) for own, true in pairs]


@pytest.mark.parametrize("shadow", [0.0, 0.5])
def test_bodies_before_a_known_scene_are_found(shadow: float) -> None:
    picture, scene, mask = drawn(shadow)
    found = segment(picture, COLOURS, scene)
    # Of bodies 25 pixels wide a third of a pixel all around is 0.97; where a shadow falls beside one, the
    # scene differs too, and half of the change lies up to a pixel further out.
    assert min(overlaps(found, mask)) > (0.91 if shadow else 0.95)
    assert found.scores.min() > 0.9
    outline = outline_of_mask(found.mask, 2)
    # The outlines that identification takes, beside those of the true mask: pixels are 1 or 2 away.
    edge = ndimage.distance_transform_edt(mask == 1) + ndimage.distance_transform_edt(mask != 1)
    columns, rows = outline.points[outline.inside == 0].astype(int).T
    assert np.median(edge[rows, columns]) <= 2


def test_a_wrong_scene_is_told_by_the_score() -> None:
    picture, scene, mask = drawn()
    wrong = np.roll(255 - scene, 40, axis=1)
    found = segment(picture, COLOURS, wrong)
    assert min(overlaps(found, mask)) < 0.8
    assert found.scores.min() < 0.7


def test_something_else_in_the_picture_is_not_known() -> None:
    picture, scene, _ = drawn()
    picture[120:160, 20:70] = (30, 200, 40)
    found = segment(picture, COLOURS, scene)
    assert np.mean(found.mask[123:157, 23:67] == UNKNOWN) > 0.95


def test_colours_alone_do_where_nothing_else_has_them() -> None:
    picture, _, mask = drawn()
    picture[mask == 0] = (90, 220, 90)
    assert min(overlaps(segment(picture, COLOURS, None), mask)) > 0.9


def test_what_cannot_be_segmented_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture, scene, _ = drawn()
    with pytest.raises(
        DataError, match=r"a.png: expected 200×168 pixels, as the empty scene has, got 224×168"
    ):
        segment(picture, COLOURS, scene[:, :200], "a.png")
    with pytest.raises(InputError, match="expected bodies that differ, got 225,160,130 and 220,160,128"):
        segment(picture, np.array([COLOURS[0], [220.0, 160.0, 128.0]]), scene)
    nothing = segment(scene, COLOURS, scene)
    assert not (nothing.mask % UNKNOWN).any()
    assert (nothing.scores == 0).all()
    for words, said in (
        (["--colours", "1,2,3"], "expected one for each of finger, exosuit, got 1"),
        (["--colours", "1,2,3", "1,2,300"], "expected red,green,blue of 0 to 255"),
    ):
        with pytest.raises(SystemExit):
            main(["segment", str(tmp_path), *words, "--out", str(tmp_path / "masks")])
        assert said in capsys.readouterr().err


def test_the_command_writes_masks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture, scene, mask = drawn(0.5)
    photos = tmp_path / "photos"
    photos.mkdir()
    cv2.imwrite(str(photos / "one.png"), picture[..., ::-1])
    cv2.imwrite(str(photos / "none.png"), scene[..., ::-1])
    cv2.imwrite(str(tmp_path / "empty.png"), scene[..., ::-1])
    out, plot = tmp_path / "masks", tmp_path / "masks.png"
    words = ["--empty", str(tmp_path / "empty.png"), "--colours", "225,160,130", "40,60,150"]
    main(["segment", str(photos), *words, "--out", str(out), "--plot", str(plot)])
    found = cv2.imread(str(out / "one.png"), cv2.IMREAD_GRAYSCALE)
    assert found is not None
    assert min(overlaps(Segmented(found, np.ones(2)), mask)) > 0.91
    assert "1 of 2 masks have a score below 0.9, the first of none.png" in capsys.readouterr().err
    assert plot.stat().st_size > 10_000

"""Objects before the bodies cover what they are said to; other fingers are fingers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exosight.exosuit.finger import Finger
from exosight.vision import BACKGROUND, Camera, augment
from exosight.vision.occlusion import LINK_LENGTHS, LINK_RADII, draw_fingers, occluder, overlay
from exosight.vision.transforms.foreground import OCCLUSION_KINDS


@settings(deadline=None, max_examples=60)
@given(
    st.sampled_from(OCCLUSION_KINDS),
    st.floats(0.01, 0.5),
    st.floats(0, 1),
    st.floats(0, 6.3),
    st.integers(0, 2**34),
)
def test_an_object_covers_the_stated_share(clean, kind, share, at, angle, seed) -> None:
    mask = occluder(kind, clean[3], share, at, angle, seed)
    # The soft edge is a mean over three pixels; at the picture's border it takes the inner pixel twice, which
    # moves at most a third of each border pixel: 4 × 128 / 3 of 128². And the mask is rounded.
    assert mask.mean() / 255 == pytest.approx(share, abs=4 / 128 / 3 + 1 / 255)
    outline = np.count_nonzero((mask > 0) & (mask < 255))
    hidden = np.count_nonzero(mask == 255)
    assert hidden + outline >= round(share * mask.size)
    np.testing.assert_array_equal(mask, occluder(kind, clean[3], share, at, angle, seed))


@pytest.mark.parametrize("kind", ["ellipse", "polygon", "bar", "blob"])
def test_an_object_lies_on_the_bodies(clean, kind: str) -> None:
    for at in np.linspace(0, 1, 9):
        mask = occluder(kind, clean[2], 0.05, at, 0.5, 7)
        assert np.any((mask == 255) & (clean[2] != BACKGROUND))


def test_it_is_centred_on_the_pixel_it_names(clean) -> None:
    rows, columns = np.nonzero(clean[2] != BACKGROUND)
    for at in (0.2, 0.5, 0.9):
        pixel = int(at * len(rows))
        mask = occluder("ellipse", clean[2], 0.02, at, 0.3, 0).astype(float)
        i, j = np.indices(mask.shape)
        found = (mask * i).sum() / mask.sum(), (mask * j).sum() / mask.sum()
        assert found == pytest.approx((rows[pixel], columns[pixel]), abs=0.5)


def test_a_picture_without_bodies_is_hidden_at_its_middle() -> None:
    empty = np.full((64, 64), BACKGROUND, np.uint8)
    assert occluder("ellipse", empty, 0.05, 0.3, 0.0, 0)[32, 32] == 255


@given(st.integers(0, 255), st.floats(0, 1))
def test_what_is_put_before_hides_what_it_covers(gray: int, shade: float) -> None:
    picture, mask = np.full((1, 3), gray, np.uint8), np.array([[0, 128, 255]], np.uint8)
    seen = overlay(picture, mask, shade)[0]
    assert seen[0] == gray
    assert abs(seen[1] - (gray + 128 / 255 * (255 * shade - gray))) <= 0.51
    assert abs(seen[2] - 255 * shade) <= 0.51


def test_other_fingers_have_about_the_size_of_the_worn_one() -> None:
    worn = Finger()
    np.testing.assert_allclose(LINK_LENGTHS, worn.lengths[:3], rtol=0.03)
    np.testing.assert_allclose(LINK_RADII[0], worn.radii[0], rtol=0.05)


@pytest.mark.parametrize("side", [128, 256])
def test_other_fingers_cover_as_much_as_fingers_do(side: int) -> None:
    area = (
        sum(length * (a + b) for length, a, b in zip(LINK_LENGTHS, LINK_RADII, LINK_RADII[1:], strict=False))
        / (128 * Camera().metres_per_pixel) ** 2
    )
    for seed in range(6):
        picture = np.full((side, side), BACKGROUND, np.uint8)
        draw_fingers(picture, 1, seed)
        # Scaled by 0.85 to 1.15, round at both ends, creased at its joints, and partly out of the picture.
        assert 0.4 * area < np.mean(picture != BACKGROUND) < 2 * area


def test_fingers_behind_leave_the_bodies_and_fingers_before_hide_them(clean, cover, plain) -> None:
    frames = len(clean)
    behind = augment(clean, plain(frames, fingers_behind=2, seed=5), cover)
    np.testing.assert_array_equal(behind[cover == 255], clean[cover == 255])
    assert np.any(behind[cover == 0] != BACKGROUND)
    before = augment(clean, plain(frames, fingers_in_front=2, seed=5), cover)
    assert np.any(before[cover == 255] != clean[cover == 255])

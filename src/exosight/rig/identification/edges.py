"""Where between a body and what is beyond it the edge lies, from the gray along the normal of the edge.

The edge is placed where it conserves light: with the gray b(δ) of the body at depth δ, and B behind the edge,

    ∫ (B − g) dt = ∫₀ (B − b(δ)) dδ.

b is that of a round, matt body under the light of our own pictures, up to a factor that a sample inside
gives. Behind an edge that two bodies share, B is that of the other one. What a body covers of a pixel is
shaded as at the pixel's centre, or as at the edge where that lies outside: so b counts ½ + δ times up to a
depth of half a pixel, and b(0) an eighth of a pixel more.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from exosight.vision.renderer import AMBIENT, LAMP

NEAR, REACH = 1.75, 2.5
"""Where the gray on either side of an edge is taken, and how far its light is summed [pixels]."""
BLUR = np.sqrt(1 / 6)
"""Deviation of the weights with which linear interpolation takes the mean of pixels [pixels]."""
FAINT = 10.0
"""Gray values that two things have to differ by for an edge."""
BUMP = 15.0
"""Gray values by which a gap of a tenth of a pixel between two bodies is brighter than their common edge."""


@dataclass(frozen=True)
class Limb:
    """Gray of a round, matt body against the depth from its edge, but for a factor; or an even background.

    normal   (points, 2)   out of the body, in the picture
    radius   (points,)     [pixels]
    even     (points,)     whether it is a background
    """

    normal: Float[np.ndarray, "points 2"]
    radius: Float[np.ndarray, " points"]
    even: Bool[np.ndarray, " points"] | None = None

    def gray(self, depth: Float[np.ndarray, "points depths"]) -> Float[np.ndarray, "points depths"]:
        """Lambert's law, as the renderer has it; the same at depths below 0 as at the edge."""
        right, up, towards = LAMP
        across = (right * self.normal[:, 0] - up * self.normal[:, 1])[:, None]
        share = np.clip(1 - depth / self.radius[:, None], 0, 1)
        lit = across * share + towards * np.sqrt(1 - share**2)
        found = AMBIENT + (1 - AMBIENT) * np.maximum(lit, 0)
        return found if self.even is None else np.where(self.even[:, None], 1.0, found)

    def light(self, reach: Float[np.ndarray, " points"]) -> Float[np.ndarray, " points"]:
        """Sum of the gray from the edge to a depth of half a pixel or more, as pictures have it [pixels]."""
        root = np.linspace(0, 1, 33)[1:] - 1 / 64  # of the depth, which the gray has near the edge
        depth = reach[:, None] * root**2
        counted = np.minimum(0.5 + depth, 1) * root / root.sum()
        edge = self.gray(np.zeros((len(reach), 1)))[:, 0] / 8
        # Interpolated profiles end in means of what lies BLUR before and behind.
        rise = self.gray(reach[:, None] + BLUR * np.array([-1.0, 1.0])) @ [-1.0, 1.0] / (2 * BLUR)
        return np.sum(self.gray(depth) * counted, axis=1) * reach + edge + BLUR**2 / 2 * rise

    def interpolated(self, depth: Float[np.ndarray, " points"]) -> Float[np.ndarray, " points"]:
        """The gray at depths of BLUR or more, where a picture is linear between pixels."""
        return self.gray(depth[:, None] + BLUR * np.array([-1.0, 1.0])).mean(axis=1)


def thickness(
    own: Bool[np.ndarray, "height width"],
    points: Float[np.ndarray, "points 2"],
    inwards: Float[np.ndarray, "points 2"],
) -> Float[np.ndarray, " points"]:
    """Radius of a body beside points on its edge: the largest depth on the way inwards [pixels]."""
    depth = np.asarray(ndimage.distance_transform_edt(own))
    way = points[:, None] + np.arange(1.0, 16.0)[:, None] * inwards[:, None]
    along = sampled(depth, way.reshape(-1, 2)).reshape(len(points), -1)
    rising = np.minimum.accumulate(np.diff(along, axis=1, prepend=0) > -0.5, axis=1)  # another strand's not
    return np.maximum(np.max(np.where(rising, along, 0), axis=1), 2.0)


def balance(
    profile: Float[np.ndarray, "points samples"], t: Float[np.ndarray, " samples"], inner: Limb, outer: Limb
) -> tuple[Float[np.ndarray, " points"], Bool[np.ndarray, " points"]]:
    """Where the edge of each profile is, and whether there is one; t grows outwards [pixels]."""
    area = np.trapezoid(profile, t, axis=1)
    ends = [int(np.argmin(np.abs(t - place))) for place in (-NEAR, NEAR)]
    shift, contrast, mean = (np.zeros(len(profile)) for _ in range(3))
    for _ in range(6):  # the depth of a sample depends on where the edge is
        light: list[np.ndarray] = []
        edge: list[np.ndarray] = []
        for limb, end, side in ((inner, ends[0], -1.0), (outer, ends[1], 1.0)):
            depth = np.maximum(side * (t[end] - shift), 0.3)
            bright = profile[:, end] / limb.interpolated(depth)
            reach = REACH + side * -shift
            light.append(bright * limb.light(reach))
            edge.append(bright * limb.gray(np.zeros((len(shift), 1)))[:, 0])
        contrast, mean = edge[1] - edge[0], (edge[0] + edge[1]) / 2
        steep = np.where(np.abs(contrast) < FAINT, np.inf, contrast)
        shift = np.clip(shift + (light[0] + light[1] - area) / steep, -1.6, 1.6)
    # On the edge the picture has the mean gray of both sides; in a gap between two bodies it is brighter.
    nearest = np.abs(t - shift[:, None]).argmin(axis=1)
    on_edge = profile[np.arange(len(shift)), nearest]
    gap = on_edge > mean + BUMP
    gap |= profile[:, np.abs(t) <= 1].max(axis=1) > profile[:, ends].max(axis=1) + BUMP
    free = np.zeros(len(shift), bool) if outer.even is None else outer.even
    return shift, (np.abs(contrast) >= FAINT) & (free | ~gap)


def sampled(field: Float[np.ndarray, "height width"], points: Float[np.ndarray, "points 2"]) -> np.ndarray:
    """A field at columns and rows of the grid of pixel centres, linear in between."""
    return ndimage.map_coordinates(field, points.T[::-1], order=1, mode="nearest")

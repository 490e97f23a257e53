"""Tubes drawn in depth order: every pixel shows the surface that is nearest to the camera.

Tube by tube, a pixel looks up the sphere whose edge it is deepest in, of a tube that is tilted the one whose
surface is nearest to the camera; where a tube lies before or on itself, one for each of its strands. Of two
spheres, the share of the pixel that lies in both outlines is divided along the edge at which their surfaces
meet. It lies in the plane of equal power,

    |p − c₁|² − r₁² = |p − c₂|² − r₂²,

so bodies that pass into each other share one boundary, and neither is seen within the other. Of two side by
side that overlap by d, the first one ends d r₂/(r₁ + r₂) before its own outline, to first order in d, and the
other one d r₁/(r₁ + r₂): the thinner one gives way more. How stiff they are, and that they bulge to their
sides where they flatten, is neglected. So is what of a tube that is seen from its end lies within the outline
of a thicker part.
"""

from typing import no_type_check

import numpy as np

from exosight.vision.compiling import compiled, inlined
from exosight.vision.tube_loops import box, nearest, set_line, sphere

WITHIN = np.sqrt(0.5)
"""Cosine of the largest angle between a strand's segments and its first one: so it cannot cross itself."""


@compiled
@no_type_check
def draw_in_depth_order(images, nodes, radii, tubes, shades, lamp, ambient):
    """Draw tubes on every frame, in place.

    nodes          (frames, nodes, 3)  column, row and depth of the nodes of all tubes, one tube after another
    radii          (frames, nodes)
    tubes          (tubes + 1,)        number of the first node of each tube, and of all nodes
    shades         (frames, tubes)
    lamp, ambient  as `exosight.vision.renderer.Light` has them
    """
    frames, height, width = images.shape
    near, owner = np.full((height, width), 1.0), np.empty((height, width))
    seen = np.zeros((height, width, 12))
    lines = np.empty((nodes.shape[1], 10))
    strands = np.empty((nodes.shape[1], 3), np.int64)
    for frame in range(frames):
        c, r = nodes[frame], radii[frame]
        right, up, towards = lamp[frame]
        light = (right, up, towards, ambient[frame])
        count = _divide(c, r, tubes, lines, strands)
        for s in range(count):
            tube, begin, stop = strands[s]
            for k in range(begin, stop):
                window = box(c[k : k + 2], r[k : k + 2], height, width)
                nearest(near, owner, k, lines[k, :8], window)
            # The sphere between two strands belongs to both: the next one goes on with what it covers.
            joined = s + 1 < count and strands[s + 1, 0] == tube
            reach = r[stop] ** 2 if joined else 0.0
            ends, bright = (tubes[tube], tubes[tube + 1] - 1), 255.0 * shades[frame, tube]
            top, bottom, left, end = box(c[begin : stop + 1], r[begin : stop + 1], height, width)
            for i in range(top, bottom):
                for j in range(left, end):
                    if near[i, j] >= 0.5:
                        continue
                    x, y = j + 0.5 - c[stop, 0], i + 0.5 - c[stop, 1]
                    if x * x + y * y >= reach:
                        surface = _surface(i, j, near[i, j], lines, int(owner[i, j]), ends, bright, light)
                        _add(seen, i, j, surface)
                        near[i, j] = 1.0
        top, bottom, left, end = box(c, r, height, width)
        for i in range(top, bottom):
            for j in range(left, end):
                if seen[i, j, 0] > 0.0:
                    cover, gray = seen[i, j, 0], seen[i, j, 1]
                    if seen[i, j, 6] > 0.0:
                        found = _merged(_get(seen, i, j, 0), _get(seen, i, j, 6))
                        cover, gray = found[0], found[1]
                    under = float(images[frame, i, j])
                    images[frame, i, j] = int(under + cover * (gray - under) + 0.5)
                    seen[i, j, 0] = seen[i, j, 6] = 0.0


@compiled
@no_type_check
def _divide(c, r, tubes, lines, strands):
    """The lines and depths of all segments, and the strands of all tubes; returns how many there are.

    Of a strand: its tube, its first segment, and the one behind its last.
    Of the depth of a segment: that of its start, and its slope in the picture.
    """
    count = -1
    for tube in range(len(tubes) - 1):
        ahead_x = ahead_y = 0.0
        for k in range(tubes[tube], tubes[tube + 1] - 1):
            start = set_line(lines[k, :8], c[k : k + 2], r[k : k + 2])
            ex, ey, length = lines[k, 3], lines[k, 4], lines[k, 7]
            slope = (c[k + 1, 2] - c[k, 2]) / max(length, 1e-9)  # finite where the tube is seen from its end
            lines[k, 8:] = c[k + start, 2], slope
            turned = length > 0.0 and ex * ahead_x + ey * ahead_y < WITHIN
            if k == tubes[tube] or (turned and (ahead_x != 0.0 or ahead_y != 0.0)):
                count += 1
                strands[count, :2] = tube, k
                ahead_x = ahead_y = 0.0
            if ahead_x == ahead_y == 0.0:
                ahead_x, ahead_y = ex, ey
            strands[count, 2] = k + 1
    return count + 1


@inlined
@no_type_check
def _surface(row, column, distance, lines, number, ends, bright, light):
    """What a pixel sees of a strand: its share of the pixel, gray, and the sphere that is seen there.

    Of the sphere: from its centre to the pixel, its radius, and the depth of its centre.
    """
    x0, y0, r0, ex, ey, taper, lean, length, depth, slope = lines[number]
    beside, below, radius = sphere(column + 0.5 - x0, row + 0.5 - y0, r0, ex, ey, taper, lean, length)
    # A tube thinner than a pixel covers no more than its own width of it.
    cover = min(0.5 - distance, 2.0 * radius, 1.0)
    out = np.sqrt(max(radius**2 - (distance + radius) ** 2, 0.0))
    if slope != 0.0:
        out, beside, below, radius, depth = _foremost(row, column, number, lines, ends)
    right, up, towards, dim = light
    lit = (towards * out - up * below + right * beside) / max(radius + max(distance, 0.0), 1e-9)
    lit = min(max(lit, 0.0), 1.0)  # of large numbers round-off would make it more
    return cover, bright * (dim + (1.0 - dim) * lit), beside, below, radius, depth


@compiled
@no_type_check
def _foremost(row, column, number, lines, ends):
    """Of the spheres of a tilted tube next to a segment's, the one whose surface is nearest to the camera.

    returns  how far the surface lies before the centre; from the centre to the pixel; radius and depth
    """
    found = _tilted(row, column, lines[number])
    for step in (-1, 1):
        k = number + step
        while ends[0] <= k < ends[1]:
            other = _tilted(row, column, lines[k])
            if other[0] == 0.0:
                break
            found, k = other if other[4] - other[0] < found[4] - found[0] else found, k + step
    return found


@compiled
@no_type_check
def _tilted(row, column, line):
    """The same for one segment; the sphere lies v along the axis, where the line of sight meets the cone."""
    x0, y0, r0, ex, ey, taper, _, length, start, slope = line
    x, y = column + 0.5 - x0, row + 0.5 - y0
    a, b = 1.0 - taper * taper, x * ex + y * ey + taper * r0
    within = max(r0 * r0 - x * x - y * y + b * b / a, 0.0)
    v = min(max(b / a - slope * np.sqrt(within / (a * (a + slope * slope))), 0.0), length)
    beside, below, radius = x - v * ex, y - v * ey, r0 + taper * v
    out = np.sqrt(max(radius**2 - beside**2 - below**2, 0.0))
    return out, beside, below, radius, start + slope * v


@inlined
@no_type_check
def _add(seen, i, j, surface):
    """Add a surface to what a pixel sees: the nearest one, and all behind it as one."""
    if seen[i, j, 0] == 0.0:
        _set(seen, i, j, 0, surface)
    elif surface[0] > 0.0:
        first = _get(seen, i, j, 0)
        if _front(surface) < _front(first):
            _set(seen, i, j, 0, surface)
            surface = first
        rest = _get(seen, i, j, 6)
        _set(seen, i, j, 6, _merged(surface, rest) if rest[0] > 0.0 else surface)


@compiled
@no_type_check
def _get(seen, i, j, k):
    cover, gray, beside = seen[i, j, k], seen[i, j, k + 1], seen[i, j, k + 2]
    return cover, gray, beside, seen[i, j, k + 3], seen[i, j, k + 4], seen[i, j, k + 5]


@compiled
@no_type_check
def _set(seen, i, j, k, surface):
    seen[i, j, k], seen[i, j, k + 1], seen[i, j, k + 2] = surface[0], surface[1], surface[2]
    seen[i, j, k + 3], seen[i, j, k + 4], seen[i, j, k + 5] = surface[3], surface[4], surface[5]


@compiled
@no_type_check
def _front(surface):
    """How far away the surface is."""
    _, _, beside, below, radius, depth = surface
    return depth - np.sqrt(max(radius * radius - beside * beside - below * below, 0.0))


@compiled
@no_type_check
def _merged(one, other):
    """Two surfaces as one, with the sphere of the one that has the larger share of the pixel.

    Each outline is a straight edge in the pixel. The share within both is the smaller one where they lie on
    one side, what is left of the pixel where they face each other, their product where they are normal to
    each other, and linear in the cosine in between. Where they face each other, so does the edge of depth.
    """
    a, gray_a, ax, ay, _, _ = one
    b, gray_b, bx, by, _, _ = other
    size = np.sqrt((ax * ax + ay * ay) * (bx * bx + by * by))
    cosine = (ax * bx + ay * by) / size if size > 0.0 else 0.0
    extreme = min(a, b) if cosine > 0.0 else max(a + b - 1.0, 0.0)
    both = a * b + abs(cosine) * (extreme - a * b)
    front = _share_in_front(one, other)
    if cosine < 0.0 and both > 0.0:
        front -= cosine * (min(max((front + b - 1.0) / both, 0.0), 1.0) - front)
    here, there = a - (1.0 - front) * both, b - front * both
    gray = (here * gray_a + there * gray_b) / (here + there)
    _, _, beside, below, radius, depth = one if here >= there else other
    return here + there, gray, beside, below, radius, depth


@compiled
@no_type_check
def _share_in_front(one, other):
    """Of a pixel within both outlines, the share where the first surface lies before the other.

    The surface in front ends at the plane of equal power. The power of a point on it against the other
    sphere, divided by twice the distance between the centres, is its distance from that plane.
    """
    _, _, ax, ay, ra, za = one
    _, _, bx, by, rb, zb = other
    front_a, front_b = _front(one), _front(other)
    between = np.sqrt((ax - bx) ** 2 + (ay - by) ** 2 + (za - zb) ** 2)
    if front_a <= front_b:
        power = bx * bx + by * by + (front_a - zb) ** 2 - rb * rb
    else:
        power = ax * ax + ay * ay + (front_b - za) ** 2 - ra * ra
    power = max(power, 0.0)  # but for round-off it is not negative
    share = 1.0 if power >= between else 0.5 + power / (2.0 * between)
    return share if front_a <= front_b else 1.0 - share

"""Loops over the pixels that a tube covers, compiled to machine code.

A tube is a polyline of segments; a segment is the union of all discs along it, the radius linear between its
ends. All lengths are in pixels, and pixel (i, j) is seen at its centre, column j + 0.5 and row i + 0.5.
"""

from typing import no_type_check

import numpy as np

from exosight.vision.compiling import compiled


@compiled
@no_type_check
def draw_over(images, pixels, radii, shade, lamp, ambient):
    """Draw one tube over every frame, in place.

    pixels  (frames, nodes, 2)  column and row
    """
    frames, height, width = images.shape
    # Of the sphere nearest to each pixel: distance to its edge (negative inside), and its segment.
    distance = np.empty((height, width))
    segment = np.empty((height, width))
    lines = np.empty((radii.shape[1] - 1, 8))
    for frame in range(frames):
        c, r = pixels[frame], radii[frame]
        right, up, towards = lamp[frame]
        bright, dim = 255.0 * shade[frame], ambient[frame]
        top, bottom, left, end = box(c, r, height, width)
        distance[top:bottom, left:end] = 1.0
        for k in range(len(lines)):
            set_line(lines[k], c[k : k + 2], r[k : k + 2])
            nearest(distance, segment, k, lines[k], box(c[k : k + 2], r[k : k + 2], height, width))
        for i in range(top, bottom):
            for j in range(left, end):
                if distance[i, j] >= 0.5:
                    continue
                x0, y0, r0, ex, ey, taper, lean, length = lines[int(segment[i, j])]
                beside, below, radius = sphere(j + 0.5 - x0, i + 0.5 - y0, r0, ex, ey, taper, lean, length)
                # A tube thinner than a pixel covers no more than its own width of it.
                cover = min(0.5 - distance[i, j], 2.0 * radius, 1.0)
                away = distance[i, j] + radius
                out = np.sqrt(max(radius**2 - away**2, 0.0))
                lit = (towards * out - up * below + right * beside) / max(away, radius)
                light = dim + (1.0 - dim) * max(lit, 0.0)
                under = float(images[frame, i, j])
                images[frame, i, j] = int(under + cover * (bright * light - under) + 0.5)


@compiled
@no_type_check
def box(c, r, height, width):
    """Rows top…bottom and columns left…right that discs c, r can touch, empty if outside the picture."""
    top = left = np.inf
    bottom = right = -np.inf
    for k in range(len(r)):
        left, right = min(left, c[k, 0] - r[k]), max(right, c[k, 0] + r[k])
        top, bottom = min(top, c[k, 1] - r[k]), max(bottom, c[k, 1] + r[k])
    # One pixel more, as coverage reaches half a pixel beyond the edge. Clamped before it becomes an integer.
    top, bottom = min(max(top - 1.0, 0.0), height), min(max(bottom + 1.0, 0.0), height)
    left, right = min(max(left - 1.0, 0.0), width), min(max(right + 1.0, 0.0), width)
    return int(top), int(bottom), int(left), int(right)


@compiled
@no_type_check
def set_line(line, c, r):
    """What `sphere` needs of a segment: start and its radius, direction, taper, lean and length.

    returns  which end it starts from, 0 or 1
    """
    length = np.hypot(c[1, 0] - c[0, 0], c[1, 1] - c[0, 1])
    start = 0
    if abs(r[1] - r[0]) < (1.0 - 1e-9) * length:
        ex, ey = (c[1, 0] - c[0, 0]) / length, (c[1, 1] - c[0, 1]) / length
        taper = (r[1] - r[0]) / length
        lean = taper / np.sqrt(1.0 - taper * taper)
    else:  # one end lies within the other, and hides it
        ex = ey = taper = lean = length = 0.0
        start = 0 if r[0] > r[1] else 1
    line[:] = c[start, 0], c[start, 1], r[start], ex, ey, taper, lean, length
    return start


@compiled
@no_type_check
def sphere(x, y, r0, ex, ey, taper, lean, length):
    """Of all spheres of a segment the one nearest to a pixel: from its centre to the pixel, and its radius.

    The pixel lies x, y from the start, whose radius is r0; the axis runs along ex, ey. The sphere's
    centre lies u along the axis: the foot of the line from the pixel that is normal to the common tangent,
    clamped to the segment.
    """
    u = min(max(x * ex + y * ey + lean * abs(y * ex - x * ey), 0.0), length)
    return x - u * ex, y - u * ey, r0 + taper * u


@compiled
@no_type_check
def nearest(distance, segment, number, line, window):
    """Take over the pixels in a window that are nearer to a segment than to those before it.

    distance, segment  of the nearest sphere so far: distance to its edge (negative inside), and its segment
    window             rows top…bottom and columns left…right
    """
    top, bottom, left, right = window
    x0, y0, r0, ex, ey, taper, lean, length = line
    for i in range(top, bottom):
        near, owner = distance[i, left:right], segment[i, left:right]
        for j in range(right - left):
            x, y, radius = sphere(left + j + 0.5 - x0, i + 0.5 - y0, r0, ex, ey, taper, lean, length)
            d = np.sqrt(x * x + y * y) - radius
            take = d < near[j]
            near[j] = d if take else near[j]
            owner[j] = number if take else owner[j]

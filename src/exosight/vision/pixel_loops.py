"""Loops over the pixels of a picture, compiled to machine code."""

from typing import no_type_check

import numpy as np

from exosight.vision.compiling import compiled
from exosight.vision.counter_rng import STEP, mix
from exosight.vision.renderer import BACKGROUND


@compiled
@no_type_check
def edges(picture, darkest, lightest, opened, shade, cover):
    """How much of each pixel bodies no lighter than a shade cover, see `exosight.vision.augment.coverage`."""
    for i in range(picture.shape[0]):
        for j in range(picture.shape[1]):
            gap = picture[i, j] > 255.0 * shade + 5.0 and picture[i, j] > opened[i, j] + 30.0
            if picture[i, j] >= BACKGROUND:
                cover[i, j] = 0
            elif lightest[i, j] < BACKGROUND and not gap:
                cover[i, j] = 255
            else:
                share = (BACKGROUND - picture[i, j]) / (BACKGROUND - darkest[i, j])
                cover[i, j] = int(255.0 * share + 0.5)


@compiled
@no_type_check
def compose(picture, cover, behind, dark, contrast, out):
    """The bodies, their grays moved into a range, before another background."""
    for i in range(picture.shape[0]):
        for j in range(picture.shape[1]):
            c = np.float32(cover[i, j]) / np.float32(255)
            through = np.float32(1) - c
            bodies = max(picture[i, j] - through * np.float32(BACKGROUND), np.float32(0))
            value = np.float32(contrast) * bodies + np.float32(255 * dark) * c + through * behind[i, j]
            out[i, j] = np.uint8(min(value + np.float32(0.5), np.float32(255)))


@compiled
@no_type_check
def illuminate(picture, slope_x, slope_y, vignette, out):
    """Brightness that changes across the picture, and falls towards its corners."""
    height, width = picture.shape
    corner = np.sqrt(width * width + height * height) / 2.0
    for i in range(height):
        y = np.float32((i + 0.5 - height / 2.0) / corner)
        row = np.float32(1.0 + slope_y * y - vignette * y * y)
        for j in range(width):
            x = np.float32((j + 0.5 - width / 2.0) / corner)
            gain = row + np.float32(slope_x) * x - np.float32(vignette) * x * x
            out[i, j] = np.uint8(
                min(max(picture[i, j] * gain + np.float32(0.5), np.float32(0)), np.float32(255))
            )


@compiled
@no_type_check
def expose(picture, tone, spread, mean, quantiles, seed, out):
    """What each gray becomes, with noise: four normal numbers from each 64 random bits."""
    height, width = picture.shape
    if mean == 0.0 and spread.max() == 0.0:
        for i in range(height):
            for j in range(width):
                out[i, j] = np.uint8(tone[picture[i, j]] + np.float32(0.5))
        return
    state, bits = mix(seed + STEP), np.uint64(0)
    for i in range(height):
        for j in range(width):
            if (i * width + j) % 4 == 0:
                state += STEP
                bits = mix(state)
            gray = picture[i, j]
            value = tone[gray] + np.float32(mean) + spread[gray] * quantiles[bits & np.uint64(65535)]
            bits >>= np.uint64(16)
            out[i, j] = np.uint8(min(max(value, np.float32(0)), np.float32(255)) + np.float32(0.5))

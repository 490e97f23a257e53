"""Frames that reach the controllers of many plants: late, lost, repeated or corrupted."""

from collections import deque
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Int, UInt8

from exosight.control.batch import Plants
from exosight.control.estimator import OnnxEstimator, Reader, Reading, takes_commands
from exosight.control.guard import Measurement
from exosight.control.loop import RATE
from exosight.control.stress.episodes import Burst, Episode
from exosight.learning.model_inputs import ModelInputs
from exosight.vision.corruptions import add_noise
from exosight.vision.occlusion import HELD_OUT_OCCLUSIONS, OCCLUSIONS, occluder, overlay

Images = UInt8[np.ndarray, "episodes height width"]
Look = Callable[[Plants, Sequence[Episode], int], tuple[Images, Reading]]
"""Pictures of all plants at this step, a row an episode, and what is read off them."""


def camera_sensor(estimator: Reader) -> Look:
    """Each episode's own camera, its noise and occlusion, and a network that looks at all pictures.

    A network that takes commands gets those of the pictures.
    """

    def sense(plant: Plants, episodes: Sequence[Episode], step: int) -> tuple[Images, Reading]:
        images = np.concatenate(
            [plant.pictures(episode.camera, np.array([i])) for i, episode in enumerate(episodes)]
        )
        for image, episode in zip(images, episodes, strict=True):
            for burst in episode.bursts_at(step):
                image[:] = _corrupted(image, burst, step)
        if takes_commands(estimator):
            assert isinstance(estimator, OnnxEstimator)
            commands = plant.state.commands.astype(np.float32)
            return images, estimator.read(images, inputs=ModelInputs(commands=commands))
        return images, estimator.read(images)

    return sense


def true_sensor(plant: Plants, episodes: Sequence[Episode], step: int) -> tuple[Images, Reading]:
    """The true readings, without a network: noise scatters each output by up to 0.03 of its unit, and
    whatever hides a picture is always noticed.

    The pictures are a few bytes that differ where outputs do, for the guard to compare.
    """
    outputs = np.array(plant.state.outputs, np.float32, order="C")  # whose bytes are looked at below
    ood_score = np.zeros(len(outputs), np.float32)
    for i, episode in enumerate(episodes):
        for burst in episode.bursts_at(step):
            scatter = 0.1 * np.sqrt(burst.noise)  # [the output's unit]
            random = np.random.default_rng([burst.seed, step])
            outputs[i] += random.normal(0.0, scatter, outputs.shape[1])
            ood_score[i] = 2.0 if burst.hidden else ood_score[i]
    bounds = np.tile(np.array([0, 255], np.uint8), (len(outputs), 1))
    images = np.concatenate([bounds, outputs.view(np.uint8)], axis=1)[:, None]
    return images, Reading(outputs, outputs, outputs, (outputs > 0).astype(np.float32), ood_score)


class FrameDelivery:
    """The frames of all episodes on their way from camera to controller.

    look     at the plants
    """

    def __init__(self, episodes: Sequence[Episode], look: Look) -> None:
        self._episodes, self._look = episodes, look
        self._past: deque[tuple[Images, Reading, np.ndarray]] = deque(
            maxlen=1 + max(episode.latency for episode in episodes)
        )
        self._last: list[tuple[np.ndarray, Reading] | None] = [None] * len(episodes)

    def measurements(self, plant: Plants, step: int) -> list[Measurement]:
        """Look at the plants, and hand out what reaches the controllers in this step, one an episode.

        Before the first step every plant has stood at rest, and was looked at, for long.
        """
        self._past.append((*self._look(plant, self._episodes, step), plant.state.commands))
        seen = []
        for i, episode in enumerate(self._episodes):
            images, reading, commands = self._past[max(-1 - episode.latency, -len(self._past))]
            image, read = images[i], _row(reading, i)
            if episode.again[step] and (before := self._last[i]) is not None:
                image, read = before  # reported as a new one: its age and commands are those of a new one
            self._last[i] = image, read
            seen.append(
                Measurement()
                if episode.lost[step]
                else Measurement(image, read, episode.latency / RATE, commands[i])
            )
        return seen


def last_seen(episodes: Sequence[Episode]) -> Int[np.ndarray, "episodes steps"]:
    """The step in which the newest usable frame was taken that has come before each step's command; 0: none.

    Usable is one that is neither lost nor the last one again, and on which nothing hides the device.
    """
    seen = np.zeros((len(episodes), len(episodes[0].target)), int)
    for i, episode in enumerate(episodes):
        for step in range(1, seen.shape[1]):
            taken = max(step - 1 - episode.latency, 0)
            hidden = any(burst.hidden for burst in episode.bursts_at(taken))
            usable = not (episode.lost[step - 1] or episode.again[step - 1] or hidden)
            seen[i, step] = taken if usable else seen[i, step - 1]
    return seen


def _row(reading: Reading, i: int) -> Reading:
    own = slice(i, i + 1)
    return Reading(
        reading.forces[own], reading.low[own], reading.high[own], reading.contact[own], reading.ood_score[own]
    )


def _corrupted(image: np.ndarray, burst: Burst, step: int) -> np.ndarray:
    if not burst.hidden:
        rng = np.random.default_rng([burst.seed, step])
        return add_noise(image[None], burst.noise, rng)[0]
    # One object for the whole interval.
    rng = np.random.default_rng(burst.seed)
    kinds = (*OCCLUSIONS, *HELD_OUT_OCCLUSIONS)
    kind, at, angle, shade = (
        kinds[rng.integers(len(kinds))],
        rng.random(),
        rng.uniform(0, np.pi),
        rng.random(),
    )
    return overlay(image, occluder(kind, image, burst.hidden, at, angle, burst.seed), shade)

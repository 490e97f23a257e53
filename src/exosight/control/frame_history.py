"""Inputs of a network beside the next image of a loop: earlier images and the commands."""

from collections import deque

import numpy as np
from jaxtyping import Float, UInt8

from exosight.errors import InputError
from exosight.learning.model_file import ModelCard
from exosight.learning.model_inputs import HISTORY_SPACING, ModelInputs, command_change


class FrameHistory:
    """Keeps the last images of a loop, for a network that has them as inputs beside the newest.

    The system is quasi-static: what it did follows from the commands, not from time. So images are kept as
    far apart in the commands as those that the network learned from, however long it rests between them, and
    the history begins anew without commands, where the system is at rest.

    card   of the network: its inputs

    Raises InputError if the card asks for earlier images and does not say how far apart.
    """

    def __init__(self, card: ModelCard) -> None:
        self._card, self._apart = card, 0.0
        # The newest stands for the present, those behind it are the history.
        self._seen: deque[tuple[np.ndarray, np.ndarray]] = deque(maxlen=card.history + 1)
        if card.history:
            try:
                # Steps of a path are equal but for round-off.
                self._apart = 0.9 * float(card.data[HISTORY_SPACING])
            except (KeyError, ValueError) as error:
                raise InputError(
                    f"model: its data do not say how far its history images lie apart ({HISTORY_SPACING}); "
                    "train it with exosight train"
                ) from error

    def inputs(
        self, image: UInt8[np.ndarray, "height width"], commands: Float[np.ndarray, " channels"]
    ) -> ModelInputs:
        """The network's inputs beside this image, which is remembered.

        commands   under which it was taken [the channels' units]
        """
        commands = np.array(commands, float)
        if not commands.any():
            self._seen.clear()
        schema = self._card.schema
        if not self._seen or command_change(schema, self._seen[0][0], commands) > self._apart:
            self._seen.appendleft((commands, image))
        images = [image, *(seen for _, seen in list(self._seen)[1:])]
        images += [images[-1]] * (self._card.history + 1 - len(images))
        return ModelInputs(
            np.stack(images[1:])[None] if self._card.history else None,
            commands[None].astype(np.float32) if self._card.actuation else None,
        )

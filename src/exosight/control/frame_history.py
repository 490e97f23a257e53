"""What a network is shown beside the next image of a loop: earlier ones and commands."""

from collections import deque

import numpy as np
from jaxtyping import Float, UInt8

from exosight.errors import InputError
from exosight.learning.model_file import ModelCard
from exosight.learning.model_inputs import HISTORY_SPACING, ModelInputs


class FrameHistory:
    """Keeps the last images of a loop, for a network that sees them beside the newest.

    A plant is quasi-static: what it did follows from its commands, not from time. So images are remembered as far
    apart in their commands as those that the network was trained on, however long it rests between them, and it
    begins anew where all commands are 0 and the plant is at rest.

    card   of the network: what it asks for

    Raises InputError if the card asks for earlier images and does not tell how far apart.
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
                    f"model: its data do not tell how far its history images lie apart ({HISTORY_SPACING}); "
                    "train it with exosight train"
                ) from error

    def inputs(
        self, image: UInt8[np.ndarray, "height width"], commands: Float[np.ndarray, " channels"]
    ) -> ModelInputs:
        """What the network asks for beside this image, which is remembered.

        commands   (channels,)  under which it was taken [each in its channel's unit]
        """
        if not commands.any():
            self._seen.clear()
        if not self._seen or np.abs(commands - self._seen[0][0]).max() > self._apart:
            self._seen.appendleft((commands, image))
        images = [image, *(seen for _, seen in list(self._seen)[1:])]
        images += [images[-1]] * (self._card.history + 1 - len(images))
        return ModelInputs(
            np.stack(images[1:])[None] if self._card.history else None,
            commands[None].astype(np.float32) if self._card.actuation else None,
        )

"""How the training went."""

import numpy as np
from jaxtyping import Float, Int
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, NullLocator

from exosight.evaluation.figures.style import BLACK, ESTIMATED, GRAY, TRUE, new_figure, styled


@styled
def loss_curves(
    epochs: Int[np.ndarray, " epochs"],
    train_loss: Float[np.ndarray, " epochs"],
    validation_epochs: Int[np.ndarray, " checks"],
    validation_loss: Float[np.ndarray, " checks"],
    learning_rate: Float[np.ndarray, " epochs"],
    loss_label: str,
) -> Figure:
    """Training and validation loss over the epochs, with the learning rate below (the paper's Fig. 5).

    A step down of a learning rate that was constant before is marked through both panels.

    loss_label  the loss with its unit, for the axis: "L1 loss [N]"
    """
    figure = new_figure(height=3.0, width=4.5)
    loss, rate = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    loss.plot(epochs, train_loss, color=TRUE, label="training")
    if len(validation_loss):
        best = int(np.argmin(validation_loss))
        loss.plot(
            validation_epochs,
            validation_loss,
            color=ESTIMATED,
            marker="o",
            markersize=2.5,
            label=f"validation, best {validation_loss[best]:.3g} in epoch {validation_epochs[best]}",
        )
    loss.set(yscale="log", ylabel=loss_label)
    loss.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    loss.yaxis.set_major_formatter("{x:g}")
    loss.yaxis.set_minor_locator(NullLocator())
    loss.grid(axis="y")
    rate.plot(epochs, learning_rate, color=BLACK, drawstyle="steps-post")
    rate.set(yscale="log", xlabel="epoch", ylabel="learning rate")
    rate.yaxis.set_major_locator(LogLocator(numticks=4))
    rate.yaxis.set_minor_formatter(NullFormatter())
    for epoch in rate_drops(epochs, learning_rate):
        for ax in (loss, rate):
            ax.axvline(epoch, color=GRAY, linestyle=":", linewidth=0.9)
    loss.legend(loc="upper right")
    figure.align_ylabels()
    return figure


def rate_drops(
    epochs: Int[np.ndarray, " epochs"], learning_rate: Float[np.ndarray, " epochs"]
) -> Int[np.ndarray, " drops"]:
    """Return the epochs at which a constant learning rate fell; a continuous schedule has none."""
    steps = np.diff(learning_rate)
    return epochs[2:][(steps[1:] < 0) & (steps[:-1] == 0)]

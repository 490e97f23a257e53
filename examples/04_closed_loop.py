"""Closed-loop control of F_net to 0.25 N.

The exosuit of the publication's controller (Learning User Interaction Forces using Vision for a Soft Finger
Exosuit) starts at u = 0, without force. Ten times a second the law u_k = u_{k−1} + K_P e_k with K_P = 5
changes the actuation by five times the error e, target minus measured F_net. The measured force is the true
one here, a perfect sensor, so nothing needs to be trained; with a network it would be
`from_image(OnnxEstimator.load(path), plant.schema)` instead of `true_reading()`.

The figure shows camera images, the force and the actuation over time. The first step bends the exosuit onto
the finger, each further step halves the error approximately, and
after five steps the force stays within 5 % of the target (the publication's camera loop takes seven). The
printed number is the steady-state actuation at 0.25 N, in newtons.
"""

from pathlib import Path

from matplotlib.figure import Figure

from exosight.control import CONTROL_SHAPE, Proportional, hold, measure_response, run, true_reading
from exosight.control.responses import TOLERANCE
from exosight.control.simulated import SimulatedPlant
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.published import published

BLUE, ORANGE, GRAY = "#0072B2", "#E69F00", "#999999"
TARGET, GAIN, STEPS = 0.25, 5.0, 31


def main(folder: Path = Path("results/04_closed_loop")) -> float:
    plant = SimulatedPlant(published(Exosuit(CONTROL_SHAPE)))
    record = run(plant, Proportional(GAIN, plant.schema.channels[0]), true_reading(), hold(TARGET, STEPS))
    response = measure_response(record.time, record.target, record.true, record.command, record.driven)

    figure = Figure(figsize=(7.0, 5.2), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=(1, 2.1))
    for ax, step in zip(above.subplots(1, 5), (0, 1, 2, 3, STEPS - 1), strict=True):
        ax.imshow(record.images[step], cmap="gray", vmin=0, vmax=255)
        ax.set_axis_off()
        ax.set_title(f"{record.time[step]:.1f} s, {record.true[step]:.2f} N", fontsize=9)

    force, actuation = below.subplots(2, 1, sharex=True, height_ratios=(1.5, 1))
    band = TOLERANCE * TARGET
    force.axhspan(TARGET - band, TARGET + band, color="#EEEEEE", label="within 5 %")
    force.plot(record.time, record.target, "--", color=GRAY, label="target")
    force.plot(record.time, record.true, "o-", color=BLUE, markersize=3.5, label="F_net")
    settled = int(response.settling_steps)
    force.annotate(
        f"settled after {settled} steps",
        (record.time[settled], record.true[settled]),
        xytext=(20, -40),
        textcoords="offset points",
        fontsize=8,
        arrowprops={"arrowstyle": "->", "color": GRAY},
    )
    force.set(ylabel="force on the finger [N]", ylim=(0, 0.3))
    force.legend(frameon=False, fontsize=8, loc="lower right")
    actuation.step(record.time, record.command, where="post", color=ORANGE)
    actuation.axhline(record.command[-1], linestyle=":", color=GRAY)
    actuation.set(xlabel="time [s]", ylabel="actuation u [N]", ylim=(0, 3), xlim=(0, record.time[-1]))
    actuation.set_yticks(range(4))
    for ax in (force, actuation):
        ax.spines[["top", "right"]].set_visible(False)
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "closed_loop.png", dpi=200)
    return float(record.command[-1])


if __name__ == "__main__":
    print(f"actuation that holds {TARGET} N: {main():.4f} N")

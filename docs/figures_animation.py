"""The animation of the README and one of its camera images, by simulation and estimation.

Writes docs/images/animation.gif and docs/images/camera.png: an exosuit bends the finger while u rises and
falls; beside it the camera image, the true forces, and the estimates of the shipped network with
90 % intervals.
"""

import io
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.figure import Figure
from PIL import Image

from exosight.control import CONTROL_SHAPE, OnnxEstimator
from exosight.control.estimator import DEFAULT_MODEL, Reading
from exosight.evaluation.figures.style import BLACK, ESTIMATED, GRAY, TRUE, new_figure, show_image, styled
from exosight.evaluation.published import CONTACTS_PUBLISHED
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.published import published
from exosight.mechanics import drive
from exosight.system.camera import Camera, project
from exosight.system.observation import Observation, observe
from exosight.system.system import System, stack_systems
from exosight.vision.scene import picture

CONTACTS = tuple(contact.name for contact in CONTACTS_PUBLISHED)

IMAGES = Path(__file__).parent / "images"
TARGET, SEEN = IMAGES / "animation.gif", IMAGES / "camera.png"
SEEN_AT = 2.4  # [N], u rising: the load at which the paper gives a force
NEAR = Camera(centre=(0.047, -0.012), metres_per_pixel=2.6e-4, width=460, height=400)
NEWTON = 0.15  # length of an arrow of 1 N [m]
TOP, STEP = 3.6, 0.1  # [N]
HOLD = 4  # frames at either end
MILLISECONDS = 110  # a frame
COLOURS = 48  # of the palette: grays, two colours and their edges

Forces = Float[np.ndarray, "frames 7"]


def simulated(system: System) -> tuple[np.ndarray, Observation]:
    """u, and the system's readings and positions with u rising and falling."""
    up = np.arange(0.0, TOP + STEP / 2, STEP)
    u = np.concatenate([up, up[-2::-1]])
    found = drive([system.robot], u[:, None])
    if not found.converged.all():
        raise SystemExit("animation: a pose did not converge")
    return u, jax.tree.map(lambda leaf: np.asarray(leaf[0]), observe(stack_systems([system]), found.q))


@styled
def frame(
    u: float,
    near: UInt8[np.ndarray, "height width"],
    seen: UInt8[np.ndarray, "rows columns"],
    push: Float[np.ndarray, "8 3"],
    centres: Float[np.ndarray, "8 3"],
    radii: Float[np.ndarray, " 8"],
    true: Float[np.ndarray, " 7"],
    read: tuple[Float[np.ndarray, " 7"], ...],
    largest: float,
) -> Figure:
    """One frame of the animation; `read` is estimate, lower and upper end [N]."""
    figure = new_figure(height=2.75, width=8.0)
    figure.get_layout_engine().set(w_pad=0.02, h_pad=0.02)  # type: ignore[union-attr]
    system, camera, answer = figure.subplots(1, 3, width_ratios=(1.5, 1.3, 1.5))
    show_image(system, near)
    for centre, force, radius in zip(centres, push, radii, strict=True):
        amount = float(np.linalg.norm(force))
        if amount > 0.004:
            start = centre - force / amount * radius
            arrow = {"arrowstyle": "-|>", "color": TRUE, "linewidth": 2, "shrinkA": 0, "shrinkB": 0}
            tip = start + NEWTON * force
            system.annotate("", project(NEAR, tip) - 0.5, xytext=project(NEAR, start) - 0.5, arrowprops=arrow)
    ends = np.array([[-0.008, 0.0, -0.055], [-0.008 + 0.1 * NEWTON, 0.0, -0.055]])
    system.plot(*(project(NEAR, ends) - 0.5).T, color=TRUE, linewidth=2, solid_capstyle="butt")
    system.text(*(project(NEAR, ends[1]) + np.array([6, 4])), "0.1 N", color=TRUE, fontsize=8)
    system.set_title(f"u = {u:.1f} N", fontsize=11, fontfamily="monospace")
    show_image(camera, seen)
    camera.set_title("camera image", fontsize=10)

    place = np.arange(len(CONTACTS))
    estimate, low, high = read
    answer.barh(place - 0.2, true, height=0.36, color=TRUE, label="true")
    answer.barh(place + 0.2, estimate, height=0.36, color=ESTIMATED, label="estimated, 90 % interval")
    answer.hlines(place + 0.2, low, high, color=BLACK, linewidth=1)
    answer.set(yticks=place, yticklabels=CONTACTS, xlabel="contact force [N]", xlim=(0, largest))
    answer.set_title(
        f"F_net {true.sum():.2f} N, estimated {estimate.sum():.2f} N", fontsize=10, fontfamily="monospace"
    )
    answer.invert_yaxis()
    answer.tick_params(axis="y", length=0)
    answer.grid(axis="x")
    answer.legend(loc="lower right", fontsize=7.5, labelcolor=GRAY)
    return figure


def drawn(figure: Figure) -> Image.Image:
    """A figure as pixels."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=105)
    return Image.open(buffer).convert("RGB")


def main() -> None:
    """Simulate, estimate, draw."""
    exosuit = Exosuit(CONTROL_SHAPE)
    system = published(exosuit)
    u, found = simulated(system)
    seen, near = picture(system, found.axes), picture(published(exosuit, NEAR), found.axes)
    Image.fromarray(seen[int(np.argmin(np.abs(u - SEEN_AT)))]).save(SEEN, optimize=True)
    read: Reading = OnnxEstimator.load(DEFAULT_MODEL).read(seen)
    true = found.readings[:, system.schema.output_indices()]
    radii = np.array(exosuit.finger.sphere_radii())
    largest = 1.08 * float(max(true.max(), read.high.max()))
    pictures = [
        drawn(
            frame(
                float(u[i]), near[i], seen[i], found.forces[i], found.places[i], radii, true[i],
                (read.forces[i], read.low[i], read.high[i]), largest,
            )
        )
        for i in range(len(u))
    ]  # fmt: skip
    top = len(u) // 2
    order = [0] * HOLD + list(range(top)) + [top] * HOLD + list(range(top, len(u)))
    palette = pictures[top].quantize(COLOURS)
    frames = [pictures[i].quantize(palette=palette, dither=Image.Dither.NONE) for i in order]
    frames[0].save(
        TARGET, save_all=True, append_images=frames[1:], duration=MILLISECONDS, loop=0, optimize=True
    )
    print(f"wrote {TARGET}, {TARGET.stat().st_size / 2**20:.2f} MiB, {len(frames)} frames")


if __name__ == "__main__":
    main()

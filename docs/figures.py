"""Figures of the documentation: `make figures` draws them from simulation alone."""

from pathlib import Path

import jax
import numpy as np
from _parts.pages import save
from jaxtyping import Float, UInt8
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from exosight.control import CONTROL_SHAPE
from exosight.evaluation.figures.style import (
    BLACK,
    TRUE,
    VERMILION,
    new_figure,
    show_image,
    styled,
)
from exosight.evaluation.published import CONTACTS_PUBLISHED
from exosight.exosuit.assembly import QUADRATURE, ROD, Exosuit, assemble, varied
from exosight.exosuit.published import EXOSUIT_SHADE, FINGER_SHADE, published
from exosight.exosuit.shapes import radius
from exosight.exosuit.simulation import simulate
from exosight.exosuit.variation import Variant
from exosight.mechanics import Motion, walk
from exosight.system.camera import Camera, project
from exosight.system.observation import Observation
from exosight.vision import (
    TRAINING,
    Appearance,
    Light,
    Lighting,
    augment,
    draw_appearance,
)
from exosight.vision.renderer import AMBIENT, LAMP
from exosight.vision.scene import cover, picture
from exosight.vision.transforms.composition import BACKGROUND_KINDS
from exosight.vision.transforms.foreground import OCCLUSION_KINDS

CONTACTS = tuple(contact.name for contact in CONTACTS_PUBLISHED)

IMAGES = Path(__file__).parent / "images"
LOADS = (0.0, 0.8, 1.6, 2.4, 3.2, 4.0)
SHOWN = LOADS.index(2.4)  # the load at which the paper gives a force, 0.2 N
NEAR = Camera(centre=(0.046, -0.008), metres_per_pixel=1.3e-4, width=1000, height=700)
NEWTON = 0.2  # an arrow of 1 N is so long [m]


@styled
def overview() -> Figure:
    """The system, a camera image, its contact forces, and images along the path."""
    exosuit = Exosuit(CONTROL_SHAPE)
    found = simulate(exosuit, LOADS)
    seen = picture(published(exosuit), found.observation.axes)
    one = jax.tree.map(lambda leaf: leaf[SHOWN : SHOWN + 1], found.observation)

    figure = new_figure(height=4.4, width=8.0)
    top, bottom = figure.subfigures(2, 1, height_ratios=(2.6, 1.7))
    system, camera, forces = top.subplots(1, 3, width_ratios=(2.85, 2.0, 1.8))
    _draw_system(
        system, exosuit, found.equilibria.q[SHOWN], one, picture(published(exosuit, NEAR), one.axes)[0]
    )
    show_image(camera, seen[SHOWN])
    camera.set_title("2. Camera image")
    camera.set_xlabel("128 × 128 pixels, gray")
    _draw_forces(forces, found.reading(*CONTACTS)[SHOWN])

    for ax, image, u, force in zip(bottom.subplots(1, 6), seen, LOADS, found.reading("F_net"), strict=True):
        show_image(ax, image)
        ax.set_title(f"u = {u:.1f} N")
        ax.set_xlabel(f"F_net = {force:.2f} N", color=TRUE)
    return figure


def _draw_system(
    ax: Axes,
    exosuit: Exosuit,
    q: Float[np.ndarray, " dofs"],
    observed: Observation,
    image: UInt8[np.ndarray, "height width"],
) -> None:
    """The rendered bodies with contacts, contact forces and the line of actuation over them; one pose."""
    motion = walk(assemble(exosuit), q)
    show_image(ax, image)
    ax.plot(*_pixels(_line(exosuit, motion)).T, color=VERMILION, linewidth=2)
    centres, pushes = observed.places[0], observed.forces[0]
    contacts = zip(centres, exosuit.finger.sphere_radii(), pushes, strict=True)
    for i, (centre, size, force) in enumerate(contacts):
        ax.plot(*_pixels(centre), "o", color=BLACK, markersize=2.5)
        amount = float(np.linalg.norm(force))
        if amount > 0:
            touching = centre - force / amount * float(size)
            _arrow(ax, touching, touching + NEWTON * force, f"C{i}: {amount:.3f} N")
        elif i < 7:  # C7 lies half a millimetre from C6
            aside = (0.0135, 0.001) if i == 6 else (-0.0045, -size - 0.001)
            at = centre + np.array([aside[0], 0.0, aside[1]])
            _write(ax, "C6, C7" if i == 6 else f"C{i}", at, color=BLACK)
    _write(ax, "soft exosuit", np.array([0.022, 0.0, 0.022]), color="white")
    _write(ax, "line of actuation\nu = 2.4 N", np.array([0.078, 0.0, 0.026]), color=VERMILION)
    _write(ax, "finger", np.array([0.0085, 0.0, -0.0068]), color=BLACK)
    ends = np.array([[-0.015, 0.0, -0.05], [0.005, 0.0, -0.05]])
    ax.plot(*_pixels(ends).T, color=BLACK, linewidth=1.5, solid_capstyle="butt")
    _write(ax, "2 cm", ends.mean(axis=0) + np.array([0.0, 0.0, 0.005]), color=BLACK)
    ax.set_title("1. A soft exosuit flexes a finger")


def _arrow(ax: Axes, start: Float[np.ndarray, "3"], end: Float[np.ndarray, "3"], text: str) -> None:
    """A force as an arrow from where it acts, its name and size below the tip."""
    arrow = {
        "arrowstyle": "-|>",
        "color": TRUE,
        "linewidth": 2,
        "mutation_scale": 10,
        "shrinkA": 0,
        "shrinkB": 0,
    }
    ax.annotate("", _pixels(end), xytext=_pixels(start), arrowprops=arrow)
    _write(ax, text, end - np.array([0.0, 0.0, 0.0005]), color=TRUE)


def _write(ax: Axes, text: str, at: Float[np.ndarray, "3"], color: str) -> None:
    """Text with its upper edge at a place in the world [m]."""
    ax.text(*_pixels(at), text, color=color, ha="center", va="top", fontsize=7.5)


def _line(exosuit: Exosuit, motion: Motion) -> Float[np.ndarray, "points 3"]:
    """The line of actuation in the world: on the surface opposite to the finger [m]."""
    frames = np.asarray(motion.pose[assemble(exosuit).frame_slice(ROD)])
    surface = radius(exosuit.shape.surface, QUADRATURE.points)
    return frames[:, :3, 3] + surface[:, None] * frames[:, :3, 2]


def _pixels(points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 2"]:
    return project(NEAR, points) - 0.5  # Matplotlib counts from the centre of the first pixel


def _draw_forces(ax: Axes, forces: Float[np.ndarray, " 7"]) -> None:
    place = np.arange(len(CONTACTS))
    bars = ax.barh(place, forces, height=0.6, color=TRUE)
    ax.bar_label(bars, [f"{f:.3f}" if f > 0 else "0" for f in forces], padding=3, fontsize=7)
    ax.set(yticks=place, yticklabels=CONTACTS, xlabel="contact force [N]", xlim=(0, 0.19))
    ax.invert_yaxis()
    ax.tick_params(axis="y", length=0)
    ax.set_title("3. Contact forces to estimate")


@styled
def variation() -> Figure:
    """Variation of the plant, of the light, and of the appearance of one image."""
    exosuit = Exosuit(CONTROL_SHAPE)
    rows = {
        "plant, at 2.4 N": _varied_plants(exosuit),
        "light": _lit(exosuit),
        **_varied_pictures(exosuit),
    }
    figure = new_figure(height=9.6, width=8.0)
    for ax_row, (name, panels) in zip(figure.subplots(len(rows), 6), rows.items(), strict=True):
        for ax, (title, image) in zip(ax_row, panels, strict=True):
            show_image(ax, image)
            ax.set_title(title, fontsize=7, pad=2)
        ax_row[0].set_ylabel(name, fontsize=8)
    return figure


Panels = list[tuple[str, UInt8[np.ndarray, "height width"]]]


def _varied_plants(exosuit: Exosuit) -> Panels:
    variants = {
        "nominal": Variant(),
        "finger radius × 1.3": Variant(finger_radius=1.3),
        "links × 1.2, 0.8, 0.8": Variant(link_length=(1.2, 0.8, 0.8, 1.0)),
        "joint stiffness × 4": Variant(joint_stiffness=(4.0, 4.0, 4.0)),
        "modulus × 2": Variant(young=2.0),
        "mount + 0.2 rad, + 4 mm": Variant(mount_angle=0.2, gap=0.004),
    }
    worn = {name: varied(exosuit, variant) for name, variant in variants.items()}
    return [
        (name, picture(published(each), simulate(each, [2.4]).observation.axes)[0])
        for name, each in worn.items()
    ]


def _lit(exosuit: Exosuit) -> Panels:
    axes = simulate(exosuit, [2.4]).observation.axes

    def lit(
        lamp: tuple[float, float, float] = LAMP,
        ambient: float = AMBIENT,
        finger: float = FINGER_SHADE,
        rod: float = EXOSUIT_SHADE,
    ) -> UInt8[np.ndarray, "height width"]:
        light = Light(np.array([lamp]), np.array([ambient]))
        return picture(published(exosuit), axes, Lighting(np.array([[finger, rod]]), light))[0]

    return [
        ("lamp from the left", lit(lamp=(-0.8, 0.0, 0.6))),
        ("lamp from below", lit(lamp=(0.0, -0.8, 0.6))),
        ("ambient light only", lit(ambient=1.0)),
        ("lamp only", lit(ambient=0.0)),
        ("finger darker", lit(finger=0.45, rod=0.2)),
        ("exosuit lighter", lit(finger=0.4, rod=0.8)),
    ]


def _varied_pictures(exosuit: Exosuit) -> dict[str, Panels]:
    axes = simulate(exosuit, [2.4]).observation.axes
    one, covered = (see(published(exosuit), axes) for see in (picture, cover))

    def with_(**change: float) -> UInt8[np.ndarray, "height width"]:
        return augment(one, Appearance.neutral(1, **change), covered)[0]

    def before(kind: str) -> UInt8[np.ndarray, "height width"]:
        look = {"background_level": 0.5, "background_contrast": 0.3, "background_size": 0.15}
        number = BACKGROUND_KINDS.index(kind) + 1
        return with_(background=number, background_angle=0.5, seed=3, **look)

    def behind(kind: str) -> UInt8[np.ndarray, "height width"]:
        place = {"occlusion_at": 0.75, "occlusion_angle": 0.8, "occlusion_shade": 0.55}
        return with_(occlusion=OCCLUSION_KINDS.index(kind) + 1, occluded=0.08, seed=2, **place)

    mixed = draw_appearance(TRAINING, 3, np.arange(6))
    together = augment(np.repeat(one, 6, axis=0), mixed, np.repeat(covered, 6, axis=0))
    return {
        "camera and lens": [
            ("shift 8 %, − 8 %", with_(shift_x=0.08, shift_y=-0.08)),
            ("roll 0.4 rad", with_(roll=0.4)),
            ("zoom 1.25", with_(zoom=1.25, shift_x=0.08)),
            ("tilt 0.6 rad", with_(tilt_y=0.6)),
            ("lens + 0.2", with_(distortion=0.2)),
            ("lens − 0.2", with_(distortion=-0.2)),
        ],
        "background": [(kind, before(kind)) for kind in ("smooth", "fractal", "stripes", "checks")]
        + [(f"{kind} (held out)", before(kind)) for kind in ("cells", "grid")],
        "occlusion": [
            *((kind, behind(kind)) for kind in ("ellipse", "polygon", "bar")),
            ("mesh (held out)", behind("mesh")),
            ("fingers behind", with_(fingers_behind=2, seed=4)),
            ("finger in front", with_(fingers_in_front=1, seed=7)),
        ],
        "optics": [
            ("gradient 0.6", with_(gradient=0.6, gradient_angle=0.6)),
            ("vignette 0.7", with_(vignette=0.7)),
            ("blur 2 pixels", with_(blur=2.0)),
            ("motion 10 pixels", with_(motion=10.0, motion_angle=0.4)),
            ("contrast: 0.26 left", with_(range=0.74, dark=0.68)),
            ("gamma 1.7", with_(gamma=1.7)),
        ],
        "sensor": [
            ("noise 0.001", with_(noise=0.001, seed=1)),
            ("noise 0.01", with_(noise=0.01, seed=1)),
            ("noise 0.1", with_(noise=0.1, seed=1)),
            ("shot noise 0.03", with_(shot=0.03, seed=1)),
            ("bodies faded", with_(body_range=0.7, body_dark=0.2)),
            ("dark and noisy", with_(range=0.8, dark=0.02, noise=0.001, seed=1)),
        ],
        "drawn at random": [("", image) for image in together],
    }


def main() -> None:
    """Draw every figure."""
    IMAGES.mkdir(exist_ok=True)
    for figure in (overview, variation):
        save(figure(), IMAGES / f"{figure.__name__}.png", dpi=200)


if __name__ == "__main__":
    main()

"""A system without load, drawn in the x–z plane with its zones named, and its camera images."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from scipy.spatial import ConvexHull

from exosight.evaluation.figures.style import styled
from exosight.mechanics import Link, PressureLine, walk
from exosight.mechanics.kinematics import Motion
from exosight.mechanics.robot import Robot
from exosight.system.surfaces import PlaneSurface, SphereSurface, TubeSurface, zone_middle, zone_radius
from exosight.system.system import System
from exosight.vision.renderer import Tube, render

MOST_VIEWS = 3
"""Cameras shown; a figure of more cannot be read."""

MM = 1e3


@styled
def system_figure(system: System) -> Figure:
    """The unloaded system; lengths in mm."""
    robot = system.robot
    motion = walk(robot, jnp.zeros(robot.dofs))
    cameras = system.cameras[:MOST_VIEWS]
    figure = Figure(figsize=(7.5 + 3.2 * len(cameras), 4.2), layout="constrained")
    grid = figure.add_gridspec(1, 1 + len(cameras), width_ratios=[7, *[3] * len(cameras)])
    _draw(figure.add_subplot(grid[0]), system, robot, motion)
    tubes = [
        Tube(np.asarray(tube.axis(robot, motion))[None], np.asarray(tube.radius)[None], tube.shade)
        for tube in system.tubes
    ]
    for place, (name, camera) in enumerate(cameras, 1):
        axes = figure.add_subplot(grid[place])
        axes.imshow(render(tubes, camera, None, system.visibility)[0], cmap="gray", vmin=0, vmax=255)
        axes.set(title=f"camera {name}", xlabel="column [pixels]", ylabel="row [pixels]")
    return figure


def _draw(axes: Axes, system: System, robot: Robot, motion: Motion) -> None:
    for tube in system.tubes:
        _draw_tube(axes, tube, robot, motion)
    position = np.asarray(motion.position)[:, ::2] * MM
    for surface in system.surfaces:
        if isinstance(surface, SphereSurface):
            centres = position[list(surface.spheres.index(robot))]
            _draw_spheres(axes, centres, np.asarray(surface.spheres.radius) * MM, "0.6", 0.4)
        if isinstance(surface, PlaneSurface):
            _draw_plane(axes, *surface.plane.in_world(motion.pose[surface.plane.index(robot)]))
    _draw_zones(axes, system, robot, motion)
    joints = [body.name for body in robot.bodies if isinstance(body, Link) and body.joint.dofs]
    places = (
        np.array([np.asarray(motion[name].pose)[0, :3, 3] for name in joints]).reshape(-1, 3)[:, ::2] * MM
    )
    axes.plot(*places.T, "o", ms=5, mfc="white", mec="black", mew=1.2, zorder=3)
    for actuator in system.actuators:
        if isinstance(actuator.term, PressureLine):
            pose = np.asarray(motion[actuator.term.rod].pose)
            offset = np.asarray(actuator.term.offset)
            line = (pose[:, :3, 3] + np.einsum("pij,pj->pi", pose[:, :3, :3], offset))[:, ::2] * MM
            axes.plot(*line.T, "--", lw=1.2, color="black")
            axes.annotate(actuator.channel.name, line[-1], xytext=(4, 2), textcoords="offset points")
    axes.set(
        title=f"{system.name} without load" + (", ○ joints" if joints else ""),
        xlabel="x [mm]",
        ylabel="z [mm]",
        aspect="equal",
    )
    axes.margins(0.08, 0.2)
    axes.autoscale_view()


def _draw_zones(axes: Axes, system: System, robot: Robot, motion: Motion) -> None:
    """A circle of the surface's radius at the middle of each zone, and its name below."""
    zones = system.zones
    surfaces = {surface.name: surface for surface in system.surfaces}
    colours = colormaps["tab10"] if len(zones) <= 10 else colormaps["tab20"]
    for number, zone in enumerate(zones):
        surface = surfaces[zone.surface]
        centre = np.asarray(zone_middle(zone, surface, robot, motion))[::2] * MM
        size = float(zone_radius(zone, surface, robot)) * MM
        colour = colours(number % colours.N)
        _draw_spheres(axes, centre[None], np.array([size]), colour, 1.5)
        axes.annotate(
            zone.spec.name,
            (centre[0], centre[1] - size),
            xytext=(0, -4 - 9 * (number % 2)),  # neighbours may stand close
            textcoords="offset points",
            ha="center",
            va="top",
            color=colour,
        )


def _draw_tube(axes: Axes, tube: TubeSurface, robot: Robot, motion: Motion) -> None:
    """Each piece between two nodes is the hull of two circles."""
    axis, radii = np.asarray(tube.axis(robot, motion))[:, ::2] * MM, np.asarray(tube.radius) * MM
    around = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    circle = np.stack([np.cos(around), np.sin(around)], axis=-1)
    for i in range(len(axis) - 1):
        points = np.concatenate([axis[j] + radii[j] * circle for j in (i, i + 1)])
        outline = points[ConvexHull(points).vertices]
        axes.fill(*outline.T, color=str(0.35 + 0.6 * tube.shade), lw=0)


def _draw_plane(axes: Axes, point: Array, normal: Array) -> None:
    """A line, if the plane is seen from its edge."""
    (x, z), (across_x, across_z) = (np.asarray(each)[::2] for each in (point, normal))
    if np.hypot(across_x, across_z) > 0:
        axes.axline((x * MM, z * MM), (x * MM - across_z, z * MM + across_x), color="0.4", lw=1.2)


def _draw_spheres(axes: Axes, centres: np.ndarray, radii: np.ndarray, colour: object, width: float) -> None:
    circles = [Circle((x, z), radius) for (x, z), radius in zip(centres, radii, strict=True)]
    axes.add_collection(PatchCollection(circles, facecolor="none", edgecolor=colour, lw=width))

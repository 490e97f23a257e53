"""A small dataset: simulated frames, dropped frames, images and labels.

One exosuit of each of the publication's eleven scenarios (Learning User Interaction Forces using Vision for
a Soft Finger Exosuit) is actuated from 0 to 4 N and back, fifty frames each. Every frame is an image with its
seven true forces. The frames are written to disk, with a manifest that contains the configuration, and read
back.

The figure shows, for each exosuit, the frame with the largest F_net, with the forces on C1…C7 below, and
the number of frames kept. Thin exosuits roll up under 4 N; frames in which the rod crosses
itself, which the model does not prevent, are dropped. The printed number is the share of frames kept, in
percent. (The publication keeps 95 % of its frames; it does not mention a test for such crossings.)
"""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from exosight.dataset import Frames, read_frames, read_manifest
from exosight.dataset.generation import GenerateConfig, generate
from exosight.exosuit.scenarios import SCENARIOS

BLUE, GRAY = "#0072B2", "#BBBBBB"
FRAMES = 50
NAMES = [scenario.name.replace("_", " ") for scenario in SCENARIOS]


def show_frame(image_panel: Axes, force_panel: Axes, frames: Frames, scenario: int) -> None:
    own = np.flatnonzero(frames.scenario == scenario)
    best = own[np.argmax(frames.reading("F_net")[own])]
    image_panel.imshow(frames.images[best], cmap="gray", vmin=0, vmax=255)
    image_panel.set_axis_off()
    image_panel.set_title(f"{NAMES[scenario]}, u = {frames.commands[best, 0]:.1f} N", fontsize=8)
    force_panel.bar(frames.schema.outputs, frames.labels[best], color=BLUE)
    force_panel.set_ylim(0, 1.05 * frames.labels.max())
    force_panel.tick_params(labelsize=6)
    force_panel.spines[["top", "right"]].set_visible(False)
    if scenario % 4 == 0:
        force_panel.set_ylabel("force [N]", fontsize=7)


def main(folder: Path = Path("results/03_small_dataset")) -> float:
    data = folder / "data"
    if not data.exists():
        generate(GenerateConfig(per_scenario=1, frames=FRAMES, seed=0), data)
    manifest, frames = read_manifest(data), read_frames(data)

    figure = Figure(figsize=(7.5, 7.0), layout="constrained")
    tiles = figure.subfigures(3, 4).flat
    for scenario in range(len(NAMES)):
        show_frame(*next(tiles).subplots(2, 1, height_ratios=(2.4, 1)), frames, scenario)

    kept = np.bincount(frames.scenario, minlength=len(NAMES))
    causes = "\n".join(f"{cause.replace('_', ' ')}: {count}" for cause, count in manifest.dropped.items())
    tile = next(tiles)
    tile.suptitle(f"{len(frames)} frames kept (blue)\ndropped (gray):\n{causes}", fontsize=7)
    counts = tile.subplots()
    counts.barh(NAMES, kept, color=BLUE)
    counts.barh(NAMES, FRAMES - kept, left=kept, color=GRAY)
    counts.set(xlim=(0, FRAMES), xticks=(0, FRAMES // 2, FRAMES))
    counts.set_xlabel("frames", fontsize=7)
    counts.tick_params(labelsize=6)
    counts.spines[["top", "right"]].set_visible(False)
    counts.invert_yaxis()
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "small_dataset.png", dpi=200)
    return 100 * len(frames) / (FRAMES * len(manifest.designs))


if __name__ == "__main__":
    print(f"frames kept: {main():.1f} %")

"""From pictures of rigs to networks that read them, by commands alone.

    python -m benchmarks.rig_network

writes docs/results/rig_network.json, which `python docs/figures_identification.py` puts into its page. The
rigs are like `index`, with drawn exosuits and joints half or twice as stiff. Twelve pictures of each from 5
to 60 kPa, with blur and noise of a camera, and one force reading of 1 % error, go through

    exosight identify pictures --loads loads.csv --gain "0.08 N/kPa" --r0 … --length … --out my_rig.toml
    exosight generate --system my_rig.toml --designs 30 --appearance.noise 0.0002 --appearance.blur 1
        --appearance.shift 0.005 --out data
    exosight train --data data --pretrained shipped --epochs 12 --batch 32 --threads 1 --out net

(0.05 N/kPa is true). `exosight estimate` then reads 22 other pictures of the rig, at pressures between those
of the first twelve and on the way back, with the shipped network of `index` and with the new one.
"""

import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from benchmarks.refined import BETWEEN, LOADS, PATH, drawn, pictured
from exosight.app.bench import cpu_name
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.index import index
from exosight.exosuit.shapes import Linear

RESULTS = Path(__file__).parents[1] / "docs" / "results" / "rig_network.json"
PROGRAM = (sys.executable, "-c", "from exosight.app.main import main; main()")
JOINTS = (0.5, 2.0)
"""Stiffness of the rigs' joints over that of the shipped network's training."""
EXOSUITS = 2
GAIN, ASSUMED = 0.05, 0.08
"""Newtons a kPa: of the rig, and as --gain has it."""
READ, FORCE_NOISE = 8, 0.01
"""Number of the picture with a force reading, and the reading's error [share]."""
BLUR, NOISE = 0.5, 2.0
"""Standard deviations of the camera's blur [pixels] and noise [grays]."""
APPEARANCE = ("--appearance.noise", 0.0002, "--appearance.blur", 1, "--appearance.shift", 0.005)
"""Of the dataset: up to 3.6 grays of noise, a pixel of blur and a shift of 0.5 % of the width. Intervals are
calibrated on it; on pictures of a camera those of a dataset without held 15 % of a rig's forces."""
HELD_OUT = np.concatenate([np.arange(len(BETWEEN)), np.arange(len(BETWEEN) + 1, len(PATH))])
"""Places in PATH of the pictures that are read: all but that at 3 N, which is among the twelve."""


def run(folder: Path, *words: object) -> float:
    """Run a command in a folder; its CPU time [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([*PROGRAM, *map(str, words)], cwd=folder, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def write_pictures(
    folder: Path, images: UInt8[np.ndarray, "n h w"], random: np.random.Generator
) -> list[str]:
    """Store pictures as a camera takes them; their names."""
    folder.mkdir()
    names = [f"img_{k:02}.png" for k in range(len(images))]
    for name, image in zip(names, images, strict=True):
        blurred = cv2.GaussianBlur(image.astype(np.float64), (0, 0), BLUR)
        noisy = blurred + random.normal(scale=NOISE, size=image.shape)
        cv2.imwrite(str(folder / name), np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    return names


def write_loads(
    file: Path, names: list[str], net: Float[np.ndarray, " n"], random: np.random.Generator
) -> None:
    """The table of pressures, with one force reading."""
    reading = net[READ] * (1 + random.normal(scale=FORCE_NOISE))
    rows = [
        f"{name},{load / GAIN:.6g},{f'{reading:.6g}' if k == READ else ''}"
        for k, (name, load) in enumerate(zip(names, LOADS[:, 0], strict=True))
    ]
    file.write_text("\n".join(["picture,u [kPa],F_net [N]", *rows, ""]))


def read(folder: Path, names: list[str], label: str, *model: object) -> tuple[list[dict[str, Any]], float]:
    """What `exosight estimate` says of the held-out pictures, and its CPU time [s]."""
    told = folder / f"{label}.json"
    seconds = run(folder, "estimate", *(f"held_out/{name}" for name in names), *model, "--json", told)
    return json.loads(told.read_text())["estimates"], seconds


def shape_options(worn: Exosuit) -> list[object]:
    """The sizes that the owner of a rig measures."""
    surface = worn.shape.surface
    assert isinstance(surface, Linear)
    return ["--r0", surface.r0, "--r1", surface.r1, "--length", worn.shape.length]


def measure(number: int, joints: float, folder: Path) -> list[dict[str, Any]]:
    """Every held-out picture of a rig."""
    worn, rig = drawn(number, joints, 1.0)
    random, system = np.random.default_rng([29, number, round(10 * joints)]), index(rig)
    images, forces = pictured(system, LOADS)
    names = write_pictures(folder / "pictures", images, random)
    write_loads(folder / "loads.csv", names, forces.sum(axis=1), random)
    images, forces = (each[HELD_OUT] for each in pictured(system, PATH))
    held_out = write_pictures(folder / "held_out", images, random)
    sizes = shape_options(worn)
    gain = ("--gain", f"{ASSUMED} N/kPa")
    training = ("--epochs", 12, "--batch", 32, "--threads", 1)
    seconds = {
        "identify": run(
            folder, *("identify", "pictures", "--loads", "loads.csv", *gain, *sizes, "--out", "my_rig.toml")
        ),
        "generate": run(
            folder, *("generate", "--system", "my_rig.toml", "--designs", 30, *APPEARANCE, "--out", "data")
        ),
        "train": run(folder, "train", "--data", "data", "--pretrained", "shipped", *training, "--out", "net"),
    }
    before, _ = read(folder, held_out, "before", "--system", "index")
    after, _ = read(folder, held_out, "after", "--model", "net/model.onnx")
    return [
        {
            "rig": number,
            "joints": joints,
            "load": float(PATH[place, 0]),
            "true": true.tolist(),
            **{
                key: {
                    "force": [zone["force_N"] for zone in said["contacts"]],
                    "low": [zone["low_N"] for zone in said["contacts"]],
                    "high": [zone["high_N"] for zone in said["contacts"]],
                    "OOD score": said["ood_score"],
                }
                for key, said in (("before", first), ("after", second))
            },
            "CPU seconds": seconds,
        }
        for place, true, first, second in zip(HELD_OUT, forces, before, after, strict=True)
    ]


def main() -> None:
    """Measure and write, rig by rig."""
    rows: list[dict[str, Any]] = []
    for joints in JOINTS:
        for number in range(EXOSUITS):
            with tempfile.TemporaryDirectory() as folder:
                rows += measure(number, joints, Path(folder))
            print(f"rig {number}, joints × {joints:g}: {rows[-1]['CPU seconds']}", flush=True)
            result = {"cpu": cpu_name(), "noise [grays]": NOISE, "blur [pixels]": BLUR, "rows": rows}
            RESULTS.write_text(json.dumps(result) + "\n")


if __name__ == "__main__":
    main()

"""What another processor makes of the paper's dataset: `python -m benchmarks.processor`, some minutes.

Made twice, with all instructions of this machine and with those of SSE4.2 alone, which have no fused
multiply-add and so round otherwise. Writes docs/results/processor.json.
"""

import json
import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from exosight.app.bench import cpu_name
from exosight.dataset import dataset_identity, read_frames, read_manifest

RESULTS = Path(__file__).parents[1] / "docs" / "results" / "processor.json"
PROGRAM = "from exosight.app.main import main; main()"


def main() -> None:
    """Make both, compare, print, write."""
    with TemporaryDirectory() as place:
        folders = [
            _dataset(Path(place) / name, flags)
            for name, flags in (("whole", ""), ("sse", "--xla_cpu_max_isa=SSE4_2"))
        ]
        manifests = [read_manifest(folder) for folder in folders]
        one, other = (read_frames(folder) for folder in folders)
    pairs = zip(manifests[0].chunks, manifests[1].chunks, strict=True)
    found = {
        "cpu": cpu_name(),
        "frames": [len(one), len(other)],
        "same identity": dataset_identity(manifests[0]) == dataset_identity(manifests[1]),
        "chunks": len(manifests[0].chunks),
        "chunks of the same checksum": sum(a.sha256 == b.sha256 for a, b in pairs),
        "same shape, u and direction": all(
            np.array_equal(getattr(one, name), getattr(other, name))
            for name in ("design", "commands", "step")
        ),
        "pictures that differ": int(np.any(one.images != other.images, axis=(1, 2)).sum()),
        "largest difference of a force [N]": float(np.abs(one.labels - other.labels).max()),
        "largest difference of a coordinate": float(np.abs(one.pose - other.pose).max()),
    }
    print(json.dumps(found, indent=1))
    RESULTS.write_text(json.dumps(found, indent=1) + "\n")


def _dataset(folder: Path, flags: str) -> Path:
    words = ["generate", "--out", str(folder), "--per-scenario", "125"]
    environment = {**os.environ, "XLA_FLAGS": flags}
    subprocess.run([sys.executable, "-c", PROGRAM, *words], env=environment, check=True)
    return folder


if __name__ == "__main__":
    main()

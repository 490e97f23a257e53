"""What a dataset of measured frames says about itself: README.md."""

from collections.abc import Sequence
from pathlib import Path

from exosight.dataset.card import README
from exosight.dataset.manifest import Manifest, dataset_identity
from exosight.files import replace_file


def write_card(folder: Path, manifest: Manifest, notes: Sequence[str]) -> None:
    """Write the card of a dataset that is about to be complete, in the place of an older one.

    notes   what was decided when it was imported
    """
    replace_file(folder / README, readme(manifest, notes).encode())


def readme(manifest: Manifest, notes: Sequence[str]) -> str:
    """The card for people."""
    view, schema = manifest.schema.cameras[0], manifest.schema
    entries = [*schema.sensors, *schema.channels]
    kinds = ["a label of networks"] * len(schema.sensors) + ["a command"] * len(schema.channels)
    dropped = [f"- {cause.replace('_', ' ')}: {count}" for cause, count in manifest.dropped.items() if count]
    return "\n".join(
        [
            f"# {manifest.system}",
            "",
            f"{manifest.frames:,} gray pictures of the system `{manifest.system}`, {view.width} × "
            f"{view.height} pixels, in {len(manifest.designs)} sequences, each with what its sensors read. "
            "All of it is measured; poses are unknown.",
            "",
            "`chunk_*.h5` (HDF5) hold one row a frame, in the same order for all arrays; `design` is the "
            "number of the sequence, `step` the place in it. `manifest.json` lists these files with their "
            "SHA-256, the sequences, the sensors and the options of `exosight import`.",
            "",
            "| quantity | unit | |",
            "|---|---|---|",
            *(f"| `{e.name}` | {e.unit} | {kind} |" for e, kind in zip(entries, kinds, strict=True)),
            "",
            "How it was imported:",
            "",
            *(f"- {note}" for note in notes),
            "",
            *(["Pictures left out:", "", *dropped, ""] if dropped else []),
            "Colours became gray by Rec. 601. The licence is up to whoever took the pictures.",
            "",
            f"Made by exosight {manifest.exosight_version}. Identity (SHA-256): "
            f"`{dataset_identity(manifest)['sha256']}`",
            "",
        ]
    )

"""What a dataset says about itself: README.md for people and Hugging Face, croissant.json (Croissant 1.0).

Both follow from what is in the dataset alone, so equal datasets have equal cards.
"""

import json
from collections import Counter
from pathlib import Path
from typing import Any

from jinja2 import Environment, StrictUndefined

from exosight.dataset.config import PUBLISHED_ONLY
from exosight.dataset.frames import row_shapes
from exosight.dataset.manifest import Manifest, dataset_identity
from exosight.files import replace_file

README = "README.md"
CROISSANT = "croissant.json"
LICENCE = "MIT"

PAPER = (
    "M. I. Refai, A. Y. Alkayas, A. T. Mathew, F. Renda, T. G. Thuruthel. Learning User Interaction Forces "
    "using Vision for a Soft Finger Exosuit."
)
"""Of the preset; other systems have none."""

_CAUSES = {
    "not_converged": "no stable equilibrium was found",
    "crosses_itself": "the axis of a rod crosses itself",
}


def write_card(folder: Path, manifest: Manifest, kept: dict[str, int]) -> None:
    """Write both cards of a dataset that is about to be complete, in the place of older ones.

    kept   frames of each scenario, by its name
    """
    replace_file(folder / README, readme(manifest, kept).encode())
    replace_file(folder / CROISSANT, (json.dumps(croissant(manifest), indent=1) + "\n").encode())


def readme(manifest: Manifest, kept: dict[str, int]) -> str:
    """The card for people, with the header that Hugging Face reads."""
    plain = Environment(undefined=StrictUndefined, keep_trailing_newline=True)
    template = plain.from_string(Path(__file__).with_name("card.md").read_text(encoding="utf-8"))
    return template.render(
        name=_name(manifest),
        licence=LICENCE,
        paper=_paper(manifest),
        manifest=manifest,
        rows=row_shapes(manifest.schema, manifest.dofs),
        kept=kept,
        asked=manifest.frames + sum(manifest.dropped.values()),
        designs=Counter(manifest.scenarios[design.scenario] for design in manifest.designs),
        path=_path(manifest),
        causes=_CAUSES,
        config=json.dumps(_config(manifest), indent=1),
        identity=dataset_identity(manifest)["sha256"],
        size=_size(manifest.frames),
    )


def croissant(manifest: Manifest) -> dict[str, Any]:
    """The card for programs: files with checksums, arrays with types and units."""
    digest = dataset_identity(manifest)["sha256"]
    rows = row_shapes(manifest.schema, manifest.dofs)
    files = [
        {
            "@type": "cr:FileObject",
            "@id": chunk.file,
            "name": chunk.file,
            "contentUrl": chunk.file,
            "contentSize": f"{chunk.bytes} B",
            "encodingFormat": "application/x-hdf5",
            "sha256": chunk.sha256,
        }
        for chunk in manifest.chunks
    ]
    chunks = {
        "@type": "cr:FileSet",
        "@id": "chunks",
        "name": "chunks",
        "encodingFormat": "application/x-hdf5",
        "includes": "chunk_*.h5",
    }
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": _name(manifest),
        "description": f"{manifest.frames} simulated gray images of the system {manifest.system}, with what "
        f"its sensors read, commands and pose; {len(manifest.designs)} designs, seed {manifest.seed}.",
        "version": manifest.exosight_version,
        "license": f"https://spdx.org/licenses/{LICENCE}.html",
        "url": f"urn:sha256:{digest}",
        **({"citeAs": paper} if (paper := _paper(manifest)) else {}),
        "creator": {"@type": "sc:Organization", "name": "The exosight developers"},
        "keywords": ["soft robotics", "contact force", "simulation"],
        "distribution": [*files, chunks],
        "recordSet": [
            {
                "@type": "cr:RecordSet",
                "@id": "frames",
                "name": "frames",
                "description": "One record a frame: row k of every array of a chunk, chunk after chunk.",
                "field": [_field(name, values, rows) for name, values in manifest.quantities.items()],
            }
        ],
    }


def _field(name: str, values: dict[str, str], rows: dict[str, tuple[int, ...]]) -> dict[str, Any]:
    size = " × ".join(map(str, rows[name])) if name in rows else "one number"
    return {
        "@type": "cr:Field",
        "@id": f"frames/{name}",
        "name": name,
        "description": f"{values['meaning']} [{values['unit']}]; {values['type']}, {size} a frame",
        "dataType": "sc:Float" if values["type"].startswith("float") else "sc:Integer",
        "repeated": name in rows,
        "source": {"fileSet": {"@id": "chunks"}, "extract": {"column": name}},
    }


def _config(manifest: Manifest) -> dict[str, Any]:
    """The configuration without options that a system file leaves no choice of."""
    own = manifest.description is not None
    return {name: value for name, value in manifest.config.items() if not (own and name in PUBLISHED_ONLY)}


def _name(manifest: Manifest) -> str:
    return f"exosight simulated {manifest.system}"


def _paper(manifest: Manifest) -> str:
    return PAPER if manifest.description is None else ""


def _path(manifest: Manifest) -> str:
    """How every design is driven, in words."""
    channel, *others = manifest.schema.channels
    if others:
        return "from rest over waypoints of its own, drawn in the ranges of all channels, and back to rest"
    return f"0 → {channel.peak:g} → 0 {channel.unit}"


def _size(frames: int) -> str:
    """Hugging Face's word for a number of rows."""
    limits = {1e3: "n<1K", 1e4: "1K<n<10K", 1e5: "10K<n<100K", 1e6: "100K<n<1M", 1e7: "1M<n<10M"}
    return next((word for limit, word in limits.items() if frames < limit), "10M<n<100M")


# fmt: off
_WORDS = (
    "citeAs", "column", "equivalentProperty", "extract", "field", "fileProperty", "fileObject",
    "fileSet", "format", "includes", "isLiveDataset", "jsonPath", "key", "md5", "parentField", "path",
    "recordSet", "references", "regex", "repeated", "replace", "samplingRate", "separator", "source",
    "subField", "transform",
)
# fmt: on

_CONTEXT = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "dct": "http://purl.org/dc/terms/",
    "sc": "https://schema.org/",
    "conformsTo": "dct:conformsTo",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "examples": {"@id": "cr:examples", "@type": "@json"},
    **{word: f"cr:{word}" for word in _WORDS},
}
"""What the words of Croissant 1.0 mean, as its specification gives it."""

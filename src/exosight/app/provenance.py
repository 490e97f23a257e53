"""What a network has learned from: its record, and which frames it may be tested on."""

import json
from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Int

from exosight.app.data import Data, divided
from exosight.dataset import Manifest, Split, dataset_identity
from exosight.errors import InputError
from exosight.learning.model_file import ModelCard


def identity(
    data: Data, split: Split, extra_data: Sequence[Manifest] = (), start: ModelCard | None = None
) -> dict[str, str | int | float]:
    """What a network remembers of its data: which dataset, which camera, which part of it, which others.

    extra_data  datasets learned from as a whole
    start       of the network that it goes on from, whose data count among the others
    """
    whole = dataset_identity(data.manifest)
    others = [(str(dataset_identity(other)["sha256"]), str(other.seed)) for other in extra_data]
    hashes, seeds = ([entry[i] for entry in others] for i in range(2))
    if start:
        hashes += [*_listed(start, "sha256"), *_listed(start, "extra_data")]
        seeds += [*_listed(start, "seed"), *_listed(start, "extra_data_seeds")]
    views = {name: json.dumps(whole.pop(name)) for name in ("camera", "crop") if name in whole}
    return {
        **whole,
        **views,
        "protocol": split.protocol,
        "split_seed": split.seed,
        "held_out": split.held_out or "",
        "extra_data": _joined(hashes, own=str(whole["sha256"])),
        "extra_data_seeds": _joined(seeds, own=str(whole["seed"])),
    }


def check_unseen(pretrained: ModelCard, data: Data, split: Split) -> None:
    """Raise InputError if a network to start from is known to have learned from what is kept for testing."""
    mine, known = dataset_identity(data.manifest)["sha256"], pretrained.data
    if pretrained.schema.system != data.manifest.system:
        return
    there = known.get("protocol"), known.get("split_seed"), known.get("held_out") or None
    asked = split.protocol, split.seed, split.held_out
    seed = str(data.manifest.seed)
    alike = there == asked and _same_designs(pretrained, data.manifest)
    if mine in _listed(pretrained, "extra_data"):
        problem = "learned from the whole of this dataset"
    elif known.get("sha256") == mine and there != asked:
        problem = f"learned from this dataset divided otherwise (by {there[0]}, split seed {there[1]})"
    elif seed in _listed(pretrained, "extra_data_seeds") or (
        seed in _listed(pretrained, "seed") and not alike
    ):
        problem = f"learned from designs of the same seed, {seed}"
    elif split.protocol == "family" and there[2] != split.held_out:
        problem = f"learned from the family {split.held_out}"
    else:
        return
    raise InputError(
        f"pretrained: expected a network that has not seen what is kept for testing, got one that {problem}; "
        "divide the data as it did, generate others with a --seed of their own, or start from another"
    )


def _same_designs(card: ModelCard, manifest: Manifest) -> bool:
    """Whether a network learned from designs of the same numbers: of one seed they are divided alike."""
    known = card.data
    return (card.schema.system, known.get("seed"), known.get("designs")) == (
        *(manifest.system, manifest.seed, len(manifest.designs)),
    )


def _listed(card: ModelCard, entry: str) -> list[str]:
    """What a network remembers of its data, one by one."""
    found = str(card.data.get(entry, ""))
    return found.split(", ") if found else []


def _joined(entries: Iterable[str], own: str) -> str:
    """Each once, without those of the dataset itself."""
    return ", ".join(entry for entry in dict.fromkeys(entries) if entry != own)


def test_part(card: ModelCard, data: Data) -> tuple[Int[np.ndarray, " frames"], str]:
    """The frames that a network may be tested on, and what they are.

    Of the dataset that it learned from, the test part of its own split; the same of another one of the same
    designs divided by design; of any other, all frames, and a word of warning where it has learned from them,
    or may have.

    Raises InputError if the network does not fit the dataset's system.
    """
    manifest = data.manifest
    card.check_fits(data.frames.schema, "dataset")
    everything = np.arange(len(data.frames))
    mine = dataset_identity(manifest)["sha256"]
    if mine in _listed(card, "extra_data"):
        return everything, "all frames of a dataset that the network has learned from"
    own = card.data.get("sha256") == mine
    if own or (_same_designs(card, manifest) and card.data.get("protocol") == "design"):
        split = own_split(card, data)
        name = f"{split.protocol} ({split.held_out})" if split.held_out else split.protocol
        return split.test, f"test part by {name}"
    seed, warning = str(manifest.seed), ""
    if card.schema.system == manifest.system and seed in (
        *_listed(card, "seed"),
        *_listed(card, "extra_data_seeds"),
    ):
        warning = f", of whose designs the network may have learned from some, as it did from seed {seed}"
    return everything, f"all frames of another dataset{warning}"


def own_split(card: ModelCard, data: Data) -> Split:
    """The division that a network learned by; InputError if its file does not name one."""
    try:
        protocol, seed = str(card.data["protocol"]), int(card.data["split_seed"])
        held_out = str(card.data["held_out"]) or None
    except (KeyError, ValueError) as error:
        raise InputError(
            "model: its file does not name the part of the data that it learned from; train another"
        ) from error
    return divided(data, protocol, seed, held_out)

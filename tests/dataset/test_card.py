"""What a dataset says about itself: true, complete, and readable by the programs that it is meant for."""

import json
import re
from pathlib import Path

import pytest

from exosight.dataset.card import croissant, readme, write_card
from exosight.dataset.frames import QUANTITIES
from exosight.dataset.manifest import Manifest, read_manifest

from .conftest import SCENARIOS, SCHEMA, describe

KEPT = {scenario: 3 + k for k, scenario in enumerate(SCENARIOS)}
CAUSES = ("not_converged", "crosses_itself", "tip_below_finger")


@pytest.fixture
def manifest(dataset: Path) -> Manifest:
    dropped = {cause: 1000 + k for k, cause in enumerate(CAUSES)}
    return describe(read_manifest(dataset).chunks, dropped=dropped)


def test_the_card_counts_frames_by_scenario_and_by_filter(manifest: Manifest) -> None:
    card = readme(manifest, KEPT)
    assert "3,036 frames were simulated and 33 kept" in card
    for name, count in KEPT.items():
        designs = 1 if name == "odd" else 2  # eleven of twelve
        assert f"| `{name}` | {designs} | {count} |" in card
    for count in manifest.dropped.values():
        assert re.search(rf"^\| [a-z' ]+ \| {count:,} \|$", card, re.MULTILINE)


def test_the_card_names_every_channel_and_sensor(manifest: Manifest) -> None:
    card = readme(manifest, KEPT)
    for entry in (*SCHEMA.channels, *SCHEMA.sensors):
        assert re.search(rf"^\| \d \| `{entry.name}` \| {entry.unit} \| ", card, re.MULTILINE)
    assert "net force: P1 + P2 + P3" in card
    assert len(re.findall("a label of networks", card)) == len(SCHEMA.outputs)


def test_only_the_preset_cites_the_paper(manifest: Manifest) -> None:
    file = describe(manifest.chunks, description={"name": "bench"})
    for each, cited in ((manifest, True), (file, False)):
        assert ("Learning User Interaction Forces" in readme(each, KEPT)) == cited
        assert ("citeAs" in croissant(each)) == cited


def test_the_card_names_units_seed_configuration_licence_and_source(manifest: Manifest) -> None:
    card = readme(manifest, KEPT)
    for name, quantity in QUANTITIES.items():
        assert re.search(rf"^\| `{name}` \| .* \| {re.escape(quantity.unit)} \| ", card, re.MULTILINE)
    assert "uint8 (4 × 6)" in card
    assert "seed 0" in card
    configuration = re.search(r"```json\n(.*?)```", card, re.DOTALL)
    assert configuration
    assert json.loads(configuration[1]) == manifest.config
    assert "## Splits" in card


def test_the_card_of_a_system_file_leaves_out_options_of_the_preset(manifest: Manifest) -> None:
    config = {"system": "bench.toml", "seed": 0, "young": 3e5, "camera": {"width": 128}}
    card = readme(describe(manifest.chunks, description={"name": "bench"}, config=config), KEPT)
    assert '"system": "bench.toml"' in card
    assert '"young"' not in card
    assert '"camera"' not in card


def test_the_header_is_what_hugging_face_reads(manifest: Manifest) -> None:
    yaml = pytest.importorskip("yaml")
    header = yaml.safe_load(readme(manifest, KEPT).split("---\n")[1])
    assert header["license"] == "mit"
    assert header["size_categories"] == ["n<1K"]
    assert header["task_categories"] == ["robotics"]


@pytest.mark.filterwarnings("ignore:ConjunctiveGraph is deprecated")  # within rdflib
def test_croissant_is_valid(dataset: Path, manifest: Manifest) -> None:
    """By the reference implementation; no date is given, so that equal data have equal cards."""
    mlcroissant = pytest.importorskip("mlcroissant")
    write_card(dataset, manifest, KEPT)
    card = mlcroissant.Dataset(dataset / "croissant.json")
    issues = card.metadata.ctx.issues
    assert not issues.errors
    assert [issue for issue in issues.warnings if "datePublished" not in issue] == []


def test_croissant_lists_every_chunk_and_every_array(manifest: Manifest) -> None:
    card = croissant(manifest)
    files = {each["@id"]: each.get("sha256") for each in card["distribution"]}
    assert files == {chunk.file: chunk.sha256 for chunk in manifest.chunks} | {"chunks": None}
    fields = {each["name"]: each["description"] for each in card["recordSet"][0]["field"]}
    assert list(fields) == list(QUANTITIES)
    expected = "what every sensor reads, in the schema's order [as in the schema]; float32, 5 a frame"
    assert fields["sensors"] == expected

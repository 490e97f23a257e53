"""Datasets of systems that files describe: generated, read back, exported and resumed."""

import csv
import itertools
import multiprocessing
import shutil
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest

from exosight.dataset import (
    concatenate,
    generation,
    make_split,
    read_frames,
    read_manifest,
    read_variation,
)
from exosight.dataset.config import GenerateConfig
from exosight.dataset.designs import config_of, design_set, resolved
from exosight.dataset.export import export_dataset
from exosight.dataset.frames import QUANTITIES
from exosight.dataset.generation import generate
from exosight.dataset.job import ChunkRecord, GenerationJob
from exosight.dataset.load_paths import load_path
from exosight.dataset.matlab import from_matlab, read_mat
from exosight.dataset.simulation import simulate_designs
from exosight.dataset.stream import block_designs, stream
from exosight.errors import DataError, InputError
from exosight.exosuit.variation import PlantVariation
from exosight.mechanics import potential
from exosight.system.camera import Camera
from exosight.system.designs import FileDesigns
from exosight.system.observation import observe
from exosight.system.schema import difference
from exosight.system.system import stack_systems
from exosight.vision import AppearanceVariation, LightingVariation
from exosight.vision.scene import picture

THUMB = Path(__file__).parents[2] / "examples" / "systems" / "thumb.toml"
TWO_LINES = Path(__file__).with_name("two_lines.toml")
# A whole number of chunks of two designs, so that the solver is compiled for two robots alone.
CONFIGS = {
    "thumb": GenerateConfig(system=str(THUMB), designs=2, frames=5, seed=2),
    "two_lines": GenerateConfig(
        system=str(TWO_LINES),
        designs=6,
        frames=6,
        seed=2,
        lighting=LightingVariation(shades={"rod_tube": (0.1, 0.5)}, lamp=0.3),
        appearance=AppearanceVariation(noise=0.01),
    ),
}


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A dataset of each file, in chunks of two designs; the files are gone when they are done."""
    place = tmp_path_factory.mktemp("files")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(generation, "DESIGNS_PER_CHUNK", 2)
        for name, config in CONFIGS.items():
            copy = place / Path(config.system).name
            shutil.copy(config.system, copy)
            generate(replace(config, system=str(copy)), place / name)
            copy.unlink()
    return {name: place / name for name in CONFIGS}


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("name", CONFIGS)
def test_the_manifest_describes_the_system(folders: dict[str, Path], name: str) -> None:
    """All that a reader needs stands in it: the schema, and the entries that make the system again."""
    manifest = read_manifest(folders[name])
    nominal = FileDesigns(design_set_entries(manifest))
    assert manifest.system == name
    assert difference(manifest.schema, nominal.schema) is None
    assert manifest.camera == nominal.camera
    assert manifest.families == (name,)
    assert tuple(manifest.dropped) == ("not_converged", "crosses_itself")
    assert len(manifest.designs) == CONFIGS[name].designs
    again = design_set(config_of(manifest), manifest.description).draw(len(manifest.designs), manifest.seed)
    assert again == manifest.designs


def design_set_entries(manifest) -> dict:
    assert manifest.description is not None
    return dict(manifest.description)


@pytest.mark.parametrize("name", CONFIGS)
def test_frames_are_equilibria_of_their_designs_under_their_commands(
    folders: dict[str, Path], name: str
) -> None:
    """Forces balance to 1e-9 of those at 0.9 of the pose; sensors and commands are stored to seven digits."""
    manifest, frames = read_manifest(folders[name]), read_frames(folders[name])
    designs = design_set(config_of(manifest), manifest.description)
    balance = jax.jit(lambda robot, q, load: potential(robot)(q, load)[0].gradient)
    assert len(frames) + sum(manifest.dropped.values()) == len(manifest.designs) * CONFIGS[name].frames
    assert frames.labels.max() > 0.01  # something is pressed on
    for number in np.unique(frames.design).tolist():
        mine = np.flatnonzero(frames.design == number)
        system = designs.build(manifest.designs[number])
        path = load_path(frames.schema, CONFIGS[name].frames, manifest.seed, number)
        commands = path.commands[path.frames][frames.step[mine]]
        np.testing.assert_allclose(frames.commands[mine], commands, rtol=1e-6)
        for q, load in zip(frames.pose[mine], system.loads(commands), strict=True):
            unbalanced = max(np.abs(balance(system.robot, 0.9 * q, load)).max(), 1e-3)
            assert np.abs(balance(system.robot, q, load)).max() <= 1e-9 * unbalanced
        seen = observe(stack_systems([system]), frames.pose[mine][None])
        np.testing.assert_allclose(frames.sensors[mine], seen.readings[0], rtol=1e-6, atol=1e-9)
        if CONFIGS[name].appearance == AppearanceVariation():
            axes = {tube: np.asarray(axis)[0] for tube, axis in seen.axes.items()}
            np.testing.assert_array_equal(frames.images[mine], picture(system, axes))


def test_every_design_of_several_channels_goes_a_way_of_its_own(folders: dict[str, Path]) -> None:
    frames = read_frames(folders["two_lines"])
    paths = [frames.commands[frames.design == number] for number in np.unique(frames.design)]
    assert all(np.all(path[[0, -1]] == 0) for path in paths)
    for one, other in itertools.pairwise(paths):
        assert np.abs(one[1:-1] - other[1:-1]).max() > 0.1


def test_what_varies_is_kept_and_can_be_held_out(folders: dict[str, Path]) -> None:
    frames, columns = read_frames(folders["two_lines"]), read_variation(folders["two_lines"])
    designs = read_manifest(folders["two_lines"]).designs
    for number, young in zip(frames.design, columns["plant.rods.rod.young"], strict=True):
        assert designs[number].parameters["rods.rod.young"] == f"{float(young)!r} kPa"
    assert np.ptp(columns["lighting.rod_tube_shade"]) > 0.2
    np.testing.assert_array_equal(columns["lighting.bar_tube_shade"], np.full(len(frames), 0.6))
    split = make_split(frames, "variation", 0, "plant.rods.rod.young", columns)
    held = {int(number) for number in frames.design[split.test]}
    assert len(held) == 2  # the stiffest of six
    assert not held & {int(number) for number in frames.design[split.train]}


def test_other_programs_find_names_and_units(folders: dict[str, Path], tmp_path: Path) -> None:
    folder = folders["two_lines"]
    frames = read_frames(folder)
    export_dataset(folder, tmp_path / "data.mat")
    found = read_mat(tmp_path / "data.mat")
    np.testing.assert_array_equal(from_matlab(found, frames.schema).sensors, frames.sensors)
    assert found["sensor_names"] == ["near", "far", "both"]
    assert found["channel_units"] == ["N", "kPa"]
    (tmp_path / "tables").mkdir()
    export_dataset(folder, tmp_path / "tables")
    with (tmp_path / "tables" / "frames.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [np.float32(row["command_below_kPa"]) for row in rows] == frames.commands[:, 1].tolist()
    assert [np.float32(row["sensor_both_N"]) for row in rows] == frames.sensors[:, 2].tolist()


def test_processes_of_which_one_is_killed_make_the_same_files_without_the_system_file(
    folders: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Begun elsewhere: the folder holds job.json alone, which is all that workers need.

    Of two workers the one with the first chunk is killed when its first design is done.
    """
    pytest.importorskip("distributed")
    killed = tmp_path / "killed"

    def dies_once(place: Path, job: GenerationJob, number: int) -> ChunkRecord:
        import os
        import signal

        from exosight.dataset.generation import make_chunk

        def die(designs_done: int) -> None:
            if number == 0 and not killed.exists():
                killed.touch()
                os.kill(os.getpid(), signal.SIGKILL)

        return make_chunk(place, job, number, die)

    monkeypatch.setattr(generation, "make_chunk", dies_once)
    monkeypatch.setattr(generation, "DESIGNS_PER_CHUNK", 2)
    whole, folder = folders["two_lines"], tmp_path / "data"
    folder.mkdir()
    shutil.copy(whole / "job.json", folder)
    gone = replace(CONFIGS["two_lines"], system="elsewhere/two_lines.toml")
    generate(gone, folder, resume=True, workers=2)
    assert killed.exists()
    assert files(folder) == files(whole)


def test_a_damaged_chunk_is_made_again(
    folders: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(generation, "DESIGNS_PER_CHUNK", 2)
    shutil.copytree(folders["two_lines"], tmp_path / "data")
    (tmp_path / "data" / "chunk_0001.h5").write_bytes(b"damaged")
    generate(CONFIGS["two_lines"], tmp_path / "data", resume=True)
    assert files(tmp_path / "data") == files(folders["two_lines"])


def test_another_file_of_the_same_name_is_refused(
    folders: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(generation, "DESIGNS_PER_CHUNK", 2)
    other = tmp_path / "two_lines.toml"
    other.write_text(TWO_LINES.read_text().replace('"80 mm"', '"90 mm"'))
    with pytest.raises(InputError, match=r"another configuration \(length 80 mm there, 90 mm here\)"):
        generate(replace(CONFIGS["two_lines"], system=str(other)), folders["two_lines"], resume=True)
    with pytest.raises(DataError, match="no such file"):
        generate(replace(CONFIGS["two_lines"], system="nowhere.toml"), tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_fresh_blocks_are_what_the_simulation_gives_without_the_system_file(folders: dict[str, Path]) -> None:
    manifest = read_manifest(folders["two_lines"])
    config, designs = config_of(manifest), design_set(config_of(manifest), manifest.description)
    excluded = {designs.key(each) for each in manifest.designs}
    told = {"start": 4, "exclude": manifest.designs, "description": manifest.description}
    with stream(config, 2, **told) as blocks:
        first, second = next(blocks), next(blocks)
    assert difference(first.schema, manifest.schema) is None
    for frames, number in ((first, 4), (second, 5)):
        assert set(frames.design.tolist()) == {2 * number, 2 * number + 1}
        fresh = block_designs(designs, manifest.seed, 2, number, excluded)
        expected, _ = simulate_designs(config, designs, fresh)
        for name in QUANTITIES:
            np.testing.assert_array_equal(getattr(frames, name), getattr(expected, name), err_msg=name)
    assert not multiprocessing.active_children()


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("per_scenario", 3),
        ("young", 2e5),
        ("contact_stiffness", 500.0),
        ("gap", 1e-3),
        ("camera", Camera(width=64, height=64)),
        ("plant", PlantVariation(young=(0.5, 2.0))),
    ],
)
def test_options_of_the_published_system_are_refused_with_a_file(
    option: str, value: object, tmp_path: Path
) -> None:
    config = replace(CONFIGS["thumb"], **{option: value})
    with pytest.raises(InputError, match=f"^{option}: is an option of the published system alone"):
        generate(config, tmp_path / "data")
    assert not (tmp_path / "data").exists()


def test_the_published_system_goes_by_scenarios(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^designs: the system published goes by per_scenario"):
        generate(GenerateConfig(designs=5), tmp_path / "data")


def test_a_tube_that_is_not_there_does_not_vary(tmp_path: Path) -> None:
    config = replace(CONFIGS["two_lines"], lighting=LightingVariation(shades={"skin": (0.1, 0.2)}))
    with pytest.raises(InputError, match="expected one of bar_tube, rod_tube, got 'skin'"):
        generate(config, tmp_path / "data")
    assert not (tmp_path / "data").exists()


def test_datasets_of_different_systems_are_not_joined(folders: dict[str, Path]) -> None:
    both = [read_frames(folder) for folder in folders.values()]
    with pytest.raises(InputError, match="one kind of system; expected the channels u, got above, below"):
        concatenate(both)


def test_a_dataset_is_of_the_view_that_is_asked_for(tmp_path: Path) -> None:
    file = tmp_path / "two.toml"
    top = '[cameras.top]\ncentre = ["40 mm", "0 mm"]\npixel = "2 mm"\nwidth = 30\nheight = 20\n'
    file.write_text(TWO_LINES.read_text().replace("[cameras.side]\n", f"{top}\n[cameras.side]\n"))
    for view, names, size in (
        ("top", ["top"], (20, 30)),
        ("side", ["side"], (32, 40)),
        (None, ["top", "side"], (20, 30)),
    ):
        config, description = resolved(GenerateConfig(system=str(file), designs=1, view=view))
        schema = design_set(config, description).schema
        assert [camera.name for camera in schema.cameras] == names
        assert schema.image_size == size
    with pytest.raises(InputError, match="expected a camera of the system file, top, side, got 'back'"):
        resolved(GenerateConfig(system=str(file), view="back"))
    with pytest.raises(InputError, match="that of a preset"):
        resolved(GenerateConfig(view="side"))

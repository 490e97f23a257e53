"""What varies in a dataset: on disk as numbers that make its frames again, one by one."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from exosight.dataset import (
    Frames,
    generation,
    read_frames,
    read_manifest,
    read_variation,
    take,
    write_chunk,
)
from exosight.dataset.config import GenerateConfig
from exosight.dataset.designs import design_set, draw_designs, resolved
from exosight.dataset.generation import generate
from exosight.dataset.simulation import simulate_designs
from exosight.dataset.variation import frame_numbers, variation_columns
from exosight.errors import DataError, InputError
from exosight.exosuit.assembly import Exosuit, varied
from exosight.exosuit.published import PublishedDesigns, published
from exosight.exosuit.variation import PlantVariation, Variant
from exosight.system.observation import observe
from exosight.system.system import stack_systems
from exosight.vision import (
    TRAINING,
    Appearance,
    AppearanceVariation,
    Camera,
    Light,
    Lighting,
    LightingVariation,
    augment,
)
from exosight.vision.augment import COLUMNS
from exosight.vision.scene import cover, picture

from .conftest import made_up

PLAIN = GenerateConfig(
    per_scenario=1,
    frames=5,
    seed=3,
    young=1e6,  # stiffer than silicone, so that little snaps: a tenth of the solver's steps
    camera=Camera(metres_per_pixel=0.0044, width=32, height=24),
)
CONFIG = replace(
    PLAIN,
    plant=PlantVariation(
        link_length=(0.9, 1.1), finger_radius=(0.9, 1.1), joint_stiffness=(0.7, 1.5), young=(0.7, 1.5),
        contact_stiffness=(0.8, 1.2), gap=(0.0, 0.002), mount_angle=(-0.05, 0.05),
        mount_offset=(-0.003, 0.003),
    ),
    lighting=LightingVariation(
        shades={"finger": (0.5, 0.8), "exosuit": (0.2, 0.4)}, lamp=0.5, ambient=(0.2, 0.6)
    ),
    appearance=TRAINING,
)  # fmt: skip
NOMINAL = PublishedDesigns(Exosuit(young=PLAIN.young), camera=PLAIN.camera)
DESIGNS = NOMINAL.draw(1, 3)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset in which everything varies, in chunks of 6 and 5 designs."""
    folder = tmp_path_factory.mktemp("varied") / "data"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(generation, "DESIGNS_PER_CHUNK", 6)
        generate(CONFIG, folder)
    return folder


@pytest.fixture(scope="module")
def frames(folder: Path) -> Frames:
    return read_frames(folder)


@pytest.fixture(scope="module")
def columns(folder: Path) -> dict[str, np.ndarray]:
    return read_variation(folder)


def variant_in(columns: dict[str, np.ndarray], row: int) -> Variant:
    def number(name: str) -> float:
        return float(columns[f"plant.{name}"][row])

    return Variant(
        link_length=(number("link_length_0"), number("link_length_1"), number("link_length_2"),
                     number("link_length_3")),
        joint_stiffness=(number("joint_stiffness_0"), number("joint_stiffness_1"),
                         number("joint_stiffness_2")),
        **{name: number(name) for name in ("finger_radius", "young", "contact_stiffness", "gap",
                                           "mount_angle", "mount_offset")},
    )  # fmt: skip


def test_numbers_on_disk_make_every_frame_again(folder: Path, frames: Frames, columns) -> None:
    """From pose, shape and numbers alone: the same forces, and the same picture to the last gray."""
    designs = read_manifest(folder).designs
    for row in range(0, len(frames), 7):
        exosuit = varied(NOMINAL.exosuit(designs[int(frames.design[row])]), variant_in(columns, row))
        system = published(exosuit, CONFIG.camera)
        seen = observe(stack_systems([system]), frames.pose[None, row : row + 1])
        np.testing.assert_allclose(seen.readings[0, 0], frames.sensors[row], rtol=1e-6, atol=1e-7)  # float32
        axes = {name: np.asarray(axis)[0] for name, axis in seen.axes.items()}
        one = {name: values[row : row + 1] for name, values in columns.items()}
        lamp = np.stack([one[f"lighting.lamp_{name}"] for name in ("right", "up", "towards")], axis=-1)
        shades = np.stack([one[f"lighting.{name}_shade"] for name in ("finger", "exosuit")], axis=-1)
        clean = picture(system, axes, Lighting(shades, Light(lamp, one["lighting.ambient"])))
        look = Appearance({name: one[f"appearance.{name}"] for name in COLUMNS})
        again = augment(clean, look, cover(system, axes))
        # The pose that is observed in one call of another size may differ in the last bit, and so may a gray
        # that lies halfway.
        assert np.mean(again[0] != frames.images[row]) < 0.002


def test_every_frame_varies_and_every_design(frames: Frames, columns) -> None:
    assert all(len(values) == len(frames) for values in columns.values())
    for name in ("appearance.seed", "lighting.lamp_up", "lighting.exosuit_shade"):
        assert len(np.unique(columns[name])) == len(frames)
    for name in ("plant.young", "plant.link_length_2", "plant.mount_angle"):
        pairs = {*zip(frames.design.tolist(), columns[name].tolist(), strict=True)}
        assert len(pairs) == len(np.unique(frames.design)) == len({value for _, value in pairs})


def test_a_frame_does_not_depend_on_the_chunk_it_is_in(folder: Path, frames: Frames) -> None:
    alone, _ = simulate_designs(CONFIG, design_set(CONFIG, None), read_manifest(folder).designs[7:8])
    mine = take(frames, np.flatnonzero(frames.design == 7))
    np.testing.assert_allclose(alone.pose, mine.pose, rtol=1e-6, atol=1e-8)  # two solves to 1e-10
    assert np.mean(alone.images != mine.images) < 0.002


def test_frames_are_numbered_by_design_and_place(frames: Frames) -> None:
    numbers = frame_numbers(CONFIG, frames)
    assert np.all(numbers // 5 == frames.design)
    np.testing.assert_allclose(frames.commands[:, 0], np.array([0, 2, 4, 2, 0])[numbers % 5])
    assert len(np.unique(numbers)) == len(frames)


def test_without_variation_nothing_is_kept_and_designs_are_nominal(tmp_path: Path) -> None:
    frames = made_up(DESIGNS, schema=NOMINAL.schema)
    assert variation_columns(PLAIN, NOMINAL, DESIGNS, frames) == {}
    entry = write_chunk(tmp_path, 0, frames, {})
    with h5py.File(tmp_path / entry.file) as file:
        assert "variation" not in file
    worn = design_set(CONFIG, None)
    assert isinstance(worn, PublishedDesigns)
    assert NOMINAL.exosuit(DESIGNS[0]).young == 1e6 != worn.exosuit(DESIGNS[0]).young


def test_one_switch_keeps_its_own_part_alone() -> None:
    frames = made_up(DESIGNS, schema=NOMINAL.schema)
    for part, config in {
        "plant": replace(PLAIN, plant=PlantVariation(young=(0.5, 2.0))),
        "lighting": replace(PLAIN, lighting=LightingVariation(lamp=0.3)),
        "appearance": replace(PLAIN, appearance=AppearanceVariation(blur=1.0)),
    }.items():
        columns = variation_columns(config, design_set(config, None), DESIGNS, frames)
        assert {name.split(".")[0] for name in columns} == {part}


def test_a_dataset_without_variation_reads_as_none(dataset: Path) -> None:
    assert read_variation(dataset) == {}


def test_damaged_numbers_are_refused(tmp_path: Path, folder: Path) -> None:
    copy = tmp_path / "copy"
    copy.mkdir()
    for path in folder.iterdir():
        if path.is_file():
            (copy / path.name).write_bytes(path.read_bytes())
    chunk = copy / "chunk_0000.h5"
    content = bytearray(chunk.read_bytes())
    content[len(content) // 2] ^= 1
    chunk.write_bytes(bytes(content))
    with pytest.raises(DataError, match="checksum"):
        read_variation(copy)


def test_frames_dropped_are_counted_as_ever(folder: Path, frames: Frames) -> None:
    assert len(frames) + sum(read_manifest(folder).dropped.values()) == 55


@pytest.mark.parametrize(("asked", "low", "high"), [(None, 0.0, 0.6), ((0.1, 0.2), 0.4, 0.5)])
def test_exosuits_with_friction_differ_in_its_coefficient_by_default(
    asked: tuple[float, float] | None, low: float, high: float
) -> None:
    config, _ = resolved(GenerateConfig(system="index-friction", plant=PlantVariation(friction=asked)))
    designs = design_set(config, None)
    assert isinstance(designs, PublishedDesigns)
    found = [designs.exosuit(design).friction for design in draw_designs(config, designs)]
    assert low <= min(found) < low + 0.1 * (high - low)
    assert high - 0.1 * (high - low) < max(found) <= high
    assert resolved(GenerateConfig())[0].plant == PlantVariation()


@pytest.mark.parametrize("more", [{"appearance": TRAINING}, {"lighting": LightingVariation(lamp=0.5)}])
def test_photographs_vary_by_themselves(more: dict) -> None:
    with pytest.raises(InputError, match=r"photo: .*leave out photo, or lighting and appearance"):
        resolved(GenerateConfig(system="index", photo=True, **more))


def test_photographs_change_pictures_alone() -> None:
    config = replace(PLAIN, photo=True)
    designs = design_set(config, None)
    chosen = draw_designs(config, designs)[:2]
    plain, _ = simulate_designs(PLAIN, designs, chosen)
    found, _ = simulate_designs(config, designs, chosen)
    np.testing.assert_array_equal(found.sensors, plain.sensors)
    assert (found.images != plain.images).any(axis=(1, 2)).mean() > 0.5

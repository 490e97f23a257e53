"""A file that describes no system is refused in one sentence with the place of the fault."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from exosight.errors import DataError, InputError
from exosight.system import read_system_file
from exosight.system.designs import FileDesigns
from exosight.system.system import System

Write = Callable[..., Path]

YOUNG, RADIUS, RANGE = 'young = "300 kPa"', 'radius = "5 mm"', 'range = ["-2 N", "4 N"]'
HEAD = 'name = "small"\n'
LOW, HIGH = "1 kPa", "2 kPa"


def profile(entries: str) -> tuple[str, str]:
    return RADIUS, f'radius = {{ unit = "mm", {entries} }}'


def relax(*modes: str) -> tuple[str, str]:
    return YOUNG, f"{YOUNG}\nrelaxation = [{', '.join('{' + mode + '}' for mode in modes)}]"


def vary(entry: str, low: str, high: str) -> tuple[str, str]:
    return HEAD, f'{HEAD}vary = [{{ entry = "{entry}", low = {low}, high = {high} }}]\n'


ROW = '[sensors.row]\ntype = "force_per_length"\nsurface = "skin"\n'

FAULTS: list[tuple[tuple[str, str], str]] = [
    ((YOUNG, 'yung = "3 kPa"'), "rods.soft.yung: there is no such entry; did you mean young?"),
    ((YOUNG, YOUNG + "\ncolour = 1"), "rods.soft.colour: there is no such entry; there are length, radius,"),
    (("[sensors.near]", "[sensor.near]"), "sensor: there is no such entry; did you mean sensors?"),
    (
        ('type = "revolute", stiffness = "0.03', 'type = "revolute", stifness = "0.03'),
        "links.tip.joint.stifness: there is no such entry; did you mean stiffness?",
    ),
    ((YOUNG, 'young = "300,5 kPa"'), "rods.soft.young: expected a decimal point, like '300 kPa'"),
    ((YOUNG, 'young = "-300 kPa"'), "rods.soft.young: expected at least 1 Pa, got '-300 kPa'"),
    ((RADIUS, "radius = 5"), "rods.soft.radius: expected a number and its unit, like '45 mm', got '5'"),
    ((YOUNG, "young = 300"), "rods.soft.young: expected a number and its unit, like '300 kPa', got '300'"),
    ((YOUNG, 'young = "300"'), "rods.soft.young: expected a number and its unit"),
    ((YOUNG, 'young = "300 mm"'), "rods.soft.young: expected a modulus in Pa, kPa, MPa, GPa, got '300 mm'"),
    ((YOUNG, 'young = "nan kPa"'), "rods.soft.young: expected a number and its unit"),
    ((YOUNG, 'young = "1e999 kPa"'), "rods.soft.young: expected a finite number"),
    ((YOUNG, 'young = "1e200 kPa"'), "rods.soft.young: expected at most 1"),
    ((YOUNG, "young = nan"), "rods.soft.young: expected a finite number, got nan"),
    ((YOUNG, f"young = {'9' * 400}"), "rods.soft.young: expected a number below 2^53"),
    ((YOUNG, f"young = {'9' * 5000}"), "not TOML"),
    ((YOUNG, f"{YOUNG}\n{YOUNG}"), "not TOML (Cannot overwrite a value (at line"),
    ((YOUNG, ""), "rods.soft.young: expected a value, got none"),
    (('radius = ["10 mm", "8 mm"]', 'radius = "10 mm"'), "links.base.radius: expected a list"),
    (
        relax('share = 0.6, time = "1 s"', 'share = 0.4, time = "9 s"'),
        "expected shares of at most 0.999 in all",
    ),
    (relax('share = 0, time = "1 s"'), "rods.soft.relaxation.0.share: expected more than 0, got '0'"),
    (relax('share = 1, time = "1 s"'), "rods.soft.relaxation.0.share: expected less than 1, got '1'"),
    (
        relax('share = 0.1, time = "0 s"'),
        "rods.soft.relaxation.0.time: expected at least 0.000001 s, got '0 s'",
    ),
    (relax('share = 0.1, time = "1 N"'), "relaxation.0.time: expected a time in s, ms, min, h, got '1 N'"),
    (relax("share = 0.1"), "rods.soft.relaxation.0.time: expected a value, got none"),
    (relax('share = 0.1, tau = "1 s"'), "relaxation.0.tau: there is no such entry; there are share, time"),
    ((YOUNG, f"{YOUNG}\nrelaxation = 0.4"), "rods.soft.relaxation: expected a list"),
    ((YOUNG, f"{YOUNG}\nrelaxation = [0.4]"), "rods.soft.relaxation.0: expected a table"),
    (
        (YOUNG, f"{YOUNG}\nparent = 'hand'"),
        "rods.soft.parent: expected one of soft, base, tip, got 'hand'",
    ),
    (('length = "40 mm"', 'length = "40 mm"\nparent = "tip"'), "a cycle; one body must sit on the ground"),
    (("[links.tip]", "[links.soft]"), "rods and links: expected different names, got soft twice"),
    (
        ('surface = "pads"\nspheres', 'surface = "palm"\nspheres'),
        "sensors.near.surface: expected one of ",
    ),
    (
        ('surface = "pads"\nbody', 'surface = "skin"\nbody'),
        "sensors.far.surface: nothing presses on skin; name it in a contact",
    ),
    (
        ("spheres = [0, 1]", "spheres = [0, 4]"),
        "sensors.near.spheres: expected different numbers from 0 to 3",
    ),
    (("spheres = [0, 1]", "spheres = [1, 1]"), "sensors.near.spheres: expected different numbers"),
    (("spheres = [0, 1]", ""), "sensors.near: expected the zone as one of spheres, body and at, got none"),
    (("[sensors.far]", "[sensors.near]"), "not TOML (Cannot declare ('sensors', 'near') twice (at line"),
    (
        ('["near", "far"]', '["near", "thumb"]'),
        "sensors: sensor sum: it sums thumb, which is no sensor before it",
    ),
    (('["near", "far"]', '["near", "near"]'), "sensors.sum: parts: expected different names, got near twice"),
    (('second = "pads"', 'second = "soft_points"'), "contacts.press: both surfaces are on soft"),
    (("at = [0.5, 1.0]", ""), "surfaces.pads.at: expected places along base from 0 to 1, got none"),
    (
        ("at = [0.5, 1.0]", "at = [0.5, 1.5]"),
        "surfaces.pads.at.1: expected at most 1, got '1.5'",
    ),
    (
        ('type = "revolute", stiffness = "0.03', 'type = "fixed", stiffness = "0.03'),
        "stiffness: it has no effect with type fixed",
    ),
    (
        ('type = "joint_angle"\nbody = "tip"', 'type = "joint_angle"\nbody = "soft"'),
        "sensors.flexion.body: expected a link",
    ),
    (
        ("[sensors.sum]", '[sensors.c]\ntype = "centre_of_pressure"\nsurface = "pads"\n[sensors.sum]'),
        "sensors.c.surface: expected a tube for type centre_of_pressure, got pads",
    ),
    (
        ('type = "joint_angle"', 'type = "joint_angle"\ncomponent = "normal"'),
        "sensors.flexion: component: it has no effect with type joint_angle",
    ),
    (("[sensors.flexion]", '[sensors."a b"]'), "expected a name of at most 32 letters"),
    (('name = "small"', 'name = "\\u001b[31m"'), "name: expected a name"),
    (("format = 1", "format = 2"), "format: expected 1"),
    (("format = 1", "format = [[[[1]]]]"), "format: expected 1"),
    (("format = 1", f"format = {'[' * 40}{']' * 40}"), "nested too deeply"),
    (("format = 1", f"format = {'[' * 4000}"), "not TOML"),
    (("format = 1", f"{'a.' * 2000}b = 1"), "more than 1000 dots at line"),
    (("format = 1", "format = 1979-05-27"), "format: expected text or a number"),
    (("[sensors.near]", "[sensors]\nx = 1\n[sensors.near]"), "sensors.x: expected a table"),
    ((RANGE, 'range = ["-2 N", "4 mN"]'), "actuators.u.range: expected both ends in one unit, got N and mN"),
    ((RANGE, 'range = ["1 N", "4 N"]'), "channel u: expected a range with 0 in it, got 1…4"),
    ((RANGE, 'range = ["0 kPa", "80 kPa"]'), "actuators.u.gain: expected what a command in kPa does"),
    ((RANGE, 'range = ["0 kPa", "80 kPa"]\ngain = "5 N"'), "actuators.u.gain: expected it in N/kPa"),
    ((RANGE, 'range = ["0 N", "1e300 N"]'), "actuators.u.range: expected loads of at most"),
    ((RANGE, 'range = ["0 N", "4 N"]\nrate = "3 N"'), "actuators.u.rate: expected it in N/s"),
    (
        (RANGE, 'range = ["0 N", "4 N"]\noffset = "inf mm"'),
        "actuators.u.offset: expected a number and its unit",
    ),
    (
        (RANGE, 'range = ["0 N", "4 N"]\ncoordinate = 1'),
        "coordinate: it has no effect with type pressure_line",
    ),
    (
        ('body = "soft"\nrange', 'body = "base"\nrange'),
        "actuators.u.body: expected one of soft, got 'base'",
    ),
    (
        profile("values = [5, 4], x = [0, 0.5, 1]"),
        "rods.soft.radius: x: expected one place for each of the values, got 3 places and 2 values",
    ),
    (profile("values = [5, 4, 3], x = [0, 0.7, 0.5]"), "rods.soft.radius: expected at least two points"),
    (profile("values = [5, 4, 3], x = [0, 1, 1]"), "expected X to rise by at least 1e-06"),
    (profile("values = [5, -4]"), "rods.soft.radius.values.1: expected more than 0"),
    (profile("values = [5]"), "rods.soft.radius.values: expected at least 2 items, got '[5]'"),
    (
        profile("formula = '5', values = [5, 4]"),
        "expected one of formula, values and csv, got formula and values",
    ),
    (profile("formula = '5 - 9*X'"), "rods.soft.radius: expected 1e-06 to 10 m all along the rod, got"),
    (profile("formula = '1/(X - 1)'"), "got -0.001 m at X = 0.000"),
    (profile("formula = 'log(X - 2)'"), "got nan m"),
    (profile("formula = '().__class__'"), "expected numbers, X, pi, + - * / **"),
    (profile("formula = '5 - X^2'"), "** (power)"),
    (profile("formla = '5'"), "rods.soft.radius.formla: there is no such entry; did you mean formula?"),
    (profile("formula = 'sin(X, X)'"), "expected numbers, X, pi"),
    (profile("formula = '__import__(1)'"), "expected numbers, X, pi"),
    (profile("formula = '9**9**9**9'"), "got inf m"),
    (profile(f"formula = '{'(' * 99}X{')' * 99}'"), "got 0 m"),
    (profile(f"formula = '{'-' * 199}X'"), "all along the rod"),
    (profile(f"formula = '{'X+' * 200}X'"), "expected a formula of at most 200 characters, got 401"),
    (profile("formula = '1if X else 2'"), "expected numbers, X, pi"),
    (profile("formula = '5 + X**0.5'"), "which is too steep at X = 0.000; give the line an offset"),
    (
        profile("csv = '../small.toml'"),
        "rods.soft.radius.csv: expected the name of a file in the system file's folder",
    ),
    (profile("csv = '/etc/hostname'"), "rods.soft.radius.csv: expected the name of a file"),
    (profile('csv = "a\\u0000b"'), "rods.soft.radius.csv: expected the name of a file"),
    (profile("csv = 'none.csv'"), "small.toml: rods.soft.radius.csv: "),
    (
        vary("rods.soft.yung", f"'{LOW}'", f"'{HIGH}'"),
        "rods.soft.yung: there is no such entry in the file",
    ),
    (vary("rods.soft", f"'{LOW}'", f"'{HIGH}'"), "rods.soft: expected a single value"),
    (vary("rods.soft.young", f"'{HIGH}'", f"'{LOW}'"), "vary.0: expected low below high"),
    (
        vary("rods.soft.young", f"'{LOW}'", "'2 Pa'"),
        "vary.0: expected low and high in one unit, got kPa and Pa",
    ),
    (vary("rods.soft.young", f"'{LOW}'", "5"), "vary.0: expected low and high both with a unit or without"),
    (
        vary("rods.soft.young", "'1 mm'", "'2 mm'"),
        "vary.0: with rods.soft.young = 1.0 mm: rods.soft.young: expected a modulus",
    ),
    (vary("links.tip.length", "'-1 mm'", "'2 mm'"), "vary.0: with links.tip.length = -1.0 mm"),
    (vary("rods.soft.elements", "1", "5"), "vary.0: rods.soft.elements changes what all designs share"),
    (
        vary("actuators.u.range.1", "'1 N'", "'2 N'"),
        "vary.0: actuators.u.range.1 changes what all designs share",
    ),
    (
        vary("cameras.side.pixel", "'1 mm'", "'2 mm'"),
        "vary.0: cameras.side.pixel changes what all designs share",
    ),
]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (
            (
                "[sensors.sum]",
                '[contacts.hard]\nfirst = "skin"\nsecond = "soft_points"\nstiffness = "1 N/m"\n[sensors.sum]',
            ),
            "contacts.hard: expected line_stiffness, not stiffness, for contact of a rod",
        ),
        (
            ("[sensors.sum]", '[contacts.mixed]\nfirst = "pads"\nsecond = "soft_points"\n[sensors.sum]'),
            "contacts.mixed: expected both surfaces of spheres or none, got one",
        ),
        (
            ("[sensors.sum]", '[contacts.bones]\nfirst = "skin"\nsecond = "skin"\n[sensors.sum]'),
            "contacts.bones: both surfaces are on base; only the tube of a rod can press on itself",
        ),
        (
            (
                "[sensors.sum]",
                '[surfaces.wall]\ntype = "plane"\n'
                '[contacts.bones]\nfirst = "wall"\nsecond = "skin"\n[sensors.sum]',
            ),
            "contacts.bones: expected stiffness, not line_stiffness, for contact of links",
        ),
        (
            ("[sensors.sum]", '[surfaces.wall]\ntype = "plane"\nbodies = ["soft"]\n[sensors.sum]'),
            "surfaces.wall.bodies: expected one link that carries the plane, or none for the world",
        ),
        (
            ("[sensors.sum]", '[surfaces.wall]\ntype = "plane"\nnormal = [0, 0, 0]\n[sensors.sum]'),
            "surfaces.wall: normal: expected a direction such as [0, 0, 1], got no direction",
        ),
        (
            ("[sensors.sum]", '[surfaces.wall]\ntype = "plane"\nshade = 1\n[sensors.sum]'),
            "surfaces.wall: shade: it has no effect with type plane",
        ),
        (('bodies = ["soft"]', ""), "surfaces.soft_points: bodies: expected at least one body"),
        (
            ('second = "soft_points"', 'second = "soft_points"\nline_stiffness = "315 MPa"'),
            "contacts.press: expected a stiffness above 0 and at most 3.14e+08, 1000 times that of the rod",
        ),
        (
            ('position = ["0 mm", "0 mm", "15 mm"]', 'position = ["0 mm", "0 mm", "12.4 mm"]'),
            "contacts.press: expected surfaces that overlap at rest by at most half their radius, here "
            "2.5 mm, got 2.6 mm; move them apart",
        ),
        (
            ('radius = ["8 mm", "6 mm"]', 'radius = ["36 mm", "6 mm"]'),
            "contacts.press: expected links longer than their radii differ, else one end holds the other, "
            "got tip, 30 mm long, with radii that differ by 30 mm",
        ),
        (
            ("[sensors.sum]", f"{ROW}[sensors.sum]"),
            "sensors.row: expected places for a sensor of type force_per_length, got none",
        ),
        (
            ("[sensors.sum]", f"{ROW}places = 1\n[sensors.sum]"),
            "sensors.row.places: expected at least 2, got '1'",
        ),
        (
            ("[sensors.sum]", f"{ROW}places = 5\nestimated = true\n[sensors.sum]"),
            "sensors.row: estimated: it has no effect with type force_per_length",
        ),
        (
            ('["near", "far"]', f'["near", "row_0"]\n{ROW}places = 5'),
            "sensors: sensor sum: it sums row_0, which is no sensor before it",
        ),
        (
            ("[sensors.sum]\ntype", f"{ROW}places = 2\n[sensors.row_0]\ntype"),
            "sensors: expected different names, got row_0 twice",
        ),
        (
            ('surface = "skin"\nat = "20 mm"', 'surface = "skin"\nat = "20 mm"\ncomponent = "shear"'),
            "sensors.near.component: expected 'magnitude', 'normal' or 'tangential', got 'shear'",
        ),
        (('at = "20 mm"', 'at = "71 mm"'), "sensors.near.at: expected at most 0.07 m, the length of skin"),
        (('at = "20 mm"', 'at = "55 mm"'), "sensors.near.at: expected another place than that of far"),
        (('at = "20 mm"', 'at = "55.0004 mm"'), "sensors.near.at: expected the very place of far or one at"),
        (
            ('at = "20 mm"', 'body = "tip"'),
            "sensors.near.at: expected a distance along skin, which is a tube",
        ),
        (
            ('surface = "skin"\nat = "20', 'surface = "pads"\nat = "20'),
            "sensors.near.surface: nothing presses on pads",
        ),
    ],
)
def test_a_fault_of_tubes_is_one_sentence(
    change: tuple[str, str], sentence: str, write: Write, tubes: list
) -> None:
    with pytest.raises((InputError, DataError)) as refused:
        FileDesigns(read_system_file(write(*tubes, change)))
    assert sentence in str(refused.value)


@pytest.mark.parametrize("stiffness", [0.0, -1.0, np.nan, np.inf])
def test_a_stiffness_that_is_none_is_refused_in_python(
    stiffness: float, system: Callable[..., System], tubes: list
) -> None:
    small = system(*tubes)
    contact = replace(small.contacts[0], stiffness=np.array(stiffness))
    with pytest.raises(InputError, match=r"contacts\.press: expected a stiffness above 0 and at most"):
        replace(small, contacts=(contact,))


@pytest.mark.parametrize(("change", "sentence"), FAULTS, ids=lambda each: str(each)[-40:])
def test_a_fault_is_one_sentence_with_its_place(change: tuple[str, str], sentence: str, write: Write) -> None:
    path = write(change)
    with pytest.raises((InputError, DataError)) as refused:
        FileDesigns(read_system_file(path))
    shown = str(refused.value)
    assert sentence in shown
    assert shown.isprintable()
    assert len(shown) < 1000


def test_an_empty_file_and_what_is_no_text(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    for content, sentence in (
        (b"", "it has no entries; exosight system new makes a file to start from"),
        (b"format = 1\nname = 'a'", r"cameras: expected at least one table \[cameras.NAME\], got none"),
        (bytes(range(256)), "not UTF-8 text"),
        (b"a = 1\n" * 2_000_000, "more than 256 KiB"),
    ):
        path.write_bytes(content)
        with pytest.raises((InputError, DataError), match=sentence):
            read_system_file(path)


def test_what_is_no_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "loop.toml").symlink_to(tmp_path / "loop.toml")
    for name, sentence in (
        ("none.toml", "no such file"),
        (".", "a folder"),
        ("pipe.toml", "a device or a pipe"),
    ):
        with pytest.raises(DataError, match=sentence):
            read_system_file(tmp_path / name)
    for name in ("loop.toml", "x" * 300, "a\0b"):
        with pytest.raises(DataError):
            read_system_file(tmp_path / name)


def test_a_profile_outside_of_the_folder_is_refused_even_through_a_link(write: Write, tmp_path: Path) -> None:
    (tmp_path / "out.csv").symlink_to("/etc/hostname")
    with pytest.raises(InputError, match="expected the name of a file in the system file's folder"):
        read_system_file(write(profile("csv = 'out.csv'")))


@pytest.mark.parametrize(
    ("rows", "sentence"),
    [
        ("0,5\n0.5,4\n0.4,4\n1,3", "row 3: expected X that rises from 0 to 1"),
        ("0,5\n1,nan", "row 2: expected X and radius, two finite numbers"),
        ("0,5\n0.5\n1,4", "row 2: expected X and radius"),
        ("x,r\n0;5\n1;4", "p.csv, row 2: expected X and radius, two finite numbers with a comma between"),
        ("0,5\n1,-4", "row 2: expected X that rises from 0 to 1 and a radius above 0"),
        ("0,5\n0.9,4", "expected at least two rows, the last one at X = 1"),
        ("", "expected at least two rows"),
    ],
)
def test_a_row_of_a_profile_is_named(rows: str, sentence: str, write: Write, tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text(rows)
    with pytest.raises(InputError, match=sentence):
        read_system_file(write(profile("csv = 'p.csv'")))


LINKS = "\n".join(f"[links.l{i}]\nlength = '1 mm'\nradius = ['1 mm', '1 mm']" for i in range(3000))
FINE = "elements = 64\npoints_per_element = 32\nstrains = ['bend_y', 'bend_z', 'stretch_x', 'torsion_x']"


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (("[sensors.near]", f"{LINKS}\n[sensors.near]"), "links: expected at most 256"),
        (("elements = 3\npoints_per_element = 4", FINE), "system: expected at most 500 coordinates, got 518"),
        (("at = [0.5, 1.0]", f"at = {[i / 4000 for i in range(1002)]}"), "more than 1000 dots"),
    ],
    ids=["links", "elements", "places"],
)
def test_a_system_that_is_too_large_is_refused_before_it_is_made(
    change: tuple[str, str], sentence: str, write: Write
) -> None:
    with pytest.raises((InputError, DataError), match=sentence):
        FileDesigns(read_system_file(write(change)))

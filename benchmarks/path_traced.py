"""Scenes of a device for the path tracer Mitsuba 3: nothing here is drawn by exosight's renderer.

W. Jakob et al., Mitsuba 3, mitsuba-renderer.org. The x–z plane of the device faces a camera on the side of
negative y; lengths in centimetres, as shadows in Mitsuba start some 10⁻⁴ units away. The device is meshes of
swept circles and spheres; hand, mount, desk and clutter are made of Mitsuba's own primitives.
"""

from pathlib import Path

import cv2
import mitsuba
import numpy as np
from jaxtyping import Float, UInt8

Rng = np.random.Generator
SIDE = 128
"""Of the pictures [pixels]."""
FIELD = 14.08
"""Width of the field of view at the device [cm], as of the camera of `index`."""
SAMPLES = 32
"""Light paths a pixel."""
AROUND = 24
"""Corners of a swept circle."""
KINDS = ("plain", "desk", "cluttered")

mitsuba.set_variant("scalar_rgb")
mitsuba.set_log_level(mitsuba.LogLevel.Error)
from mitsuba import ScalarTransform4f as Transform  # noqa: E402  (it exists once the variant is set)


def picture(
    rng: Rng, kind: str, bodies: dict[str, tuple[np.ndarray, np.ndarray]], folder: Path
) -> UInt8[np.ndarray, "height width"]:
    """One picture of a device, path-traced, exposed, with noise and blur of a camera, gray 0…255.

    kind     one of KINDS
    bodies   of finger and exosuit nodes (nodes, 3) and radii (nodes,) [m]
    folder   for the meshes
    """
    scene: dict = {"type": "scene", "integrator": {"type": "path", "max_depth": 5}}
    scene |= _camera(rng) | _lights(rng) | _backdrop(rng, kind)
    (finger, wide), (exosuit, worn) = ((100 * a, 100 * r) for a, r in (bodies["finger"], bodies["exosuit"]))
    skin = _skin(rng)
    scene |= _tube("finger", finger, wide, skin, folder) | _hand(rng, finger[0], float(wide[0]), skin, folder)
    scene |= _tube("exosuit", exosuit, worn, _rubber(rng), folder) | _mount(rng, exosuit[0], float(worn[0]))
    if kind == "cluttered":
        scene |= _clutter(rng) | _cable(rng, folder)
    sampler = {"type": "independent", "sample_count": SAMPLES, "seed": int(rng.integers(2**31))}
    scene["sensor"]["sampler"] = sampler
    linear = np.array(mitsuba.render(mitsuba.load_dict(scene), seed=int(rng.integers(2**31))))
    gray = np.nan_to_num(linear[..., :3]) @ np.array([0.299, 0.587, 0.114])
    if np.mean(gray == 0) > 0.1:  # the dark side of the lamp is in the picture
        return picture(rng, kind, bodies, folder)
    return _exposed(rng, kind, gray)


def _camera(rng: Rng) -> dict:
    """Up to 8° from the normal, ± 3 % shifted, rolled by up to 5°, 35 to 90 cm away."""
    pan, tilt, roll = np.deg2rad(rng.uniform((-8, -8, -5), (8, 8, 5)))
    distance = rng.uniform(35, 90)
    target = np.array([5.0, 0.0, -0.5]) + 0.03 * FIELD * rng.uniform(-1, 1, 3) * [1, 0, 1]
    towards = np.array([np.sin(pan) * np.cos(tilt), -np.cos(pan) * np.cos(tilt), np.sin(tilt)])
    up = [np.sin(roll), 0.0, np.cos(roll)]
    angle = 2 * np.rad2deg(np.arctan(FIELD / rng.uniform(0.95, 1.05) / 2 / distance))
    film = {"type": "hdrfilm", "width": SIDE, "height": SIDE, "rfilter": {"type": "gaussian"}}
    pose = Transform().look_at(origin=(target + distance * towards).tolist(), target=target.tolist(), up=up)
    return {"sensor": {"type": "perspective", "fov": float(angle), "to_world": pose, "film": film}}


def _lights(rng: Rng) -> dict:
    """A rectangle above, left or right, on the camera's side, and a sky of uneven brightness."""
    away = np.array([rng.uniform(-40, 40), rng.uniform(-60, -20), rng.uniform(10, 60)])
    size = rng.uniform(3, 20)
    pose = Transform().look_at(origin=away.tolist(), target=[4, 0, 0], up=[0.3, 0.2, 1.0])
    radiance = float(np.exp(rng.uniform(np.log(0.3), np.log(3)))) * float(away @ away) / size**2
    sky = np.exp(0.6 * cv2.resize(rng.standard_normal((4, 8)).astype(np.float32), (64, 32)))
    sky3 = np.repeat(sky[..., None], 3, axis=2) * np.float32(rng.uniform(0.2, 0.8))
    return {
        "lamp": {
            "type": "rectangle",
            "to_world": pose @ Transform().scale([size, size, 1]),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": radiance}},
        },
        "sky": {"type": "envmap", "bitmap": mitsuba.Bitmap(np.ascontiguousarray(sky3))},
    }


def _backdrop(rng: Rng, kind: str) -> dict:
    """A plane 2 to 8 cm behind the device."""
    turn = Transform().rotate([1, 0, 0], 90) @ Transform().scale(40)
    place = Transform().translate([5, rng.uniform(2.5, 8), 0]) @ turn
    gray = rng.uniform(0.1, 0.9)
    surface = (
        _diffuse(np.full((2, 2), gray, np.float32)) if kind == "plain" else _diffuse(_printed(rng, gray, 512))
    )
    return {
        "backdrop": {"type": "rectangle", "to_world": place, "bsdf": {"type": "twosided", "bsdf": surface}}
    }


def _printed(rng: Rng, gray: float, side: int) -> Float[np.ndarray, "side side"]:
    """Reflectance of planks, marble, cloth, or lines of writing; the plane shows 80 cm, the picture 14."""
    y, x = np.mgrid[0:side, 0:side].astype(np.float32) / side
    octaves = [
        cv2.resize(
            rng.standard_normal((n, n)).astype(np.float32), (side, side), interpolation=cv2.INTER_CUBIC
        )
        / n**0.7
        for n in (8, 16, 32, 64, 128, 256)
    ]
    cloud = np.sum(octaves, axis=0)
    kind = rng.integers(5)
    if kind == 0:  # planks: rings of a log cut along, and joints
        value = np.sin(2 * np.pi * (rng.uniform(20, 60) * x + 2.5 * cloud + rng.uniform(1, 3) * y))
        value = np.where((x * rng.uniform(6, 14)) % 1 < 0.03, -2.0, value)
    elif kind == 1:  # marble
        value = np.abs(np.sin(6 * cloud * rng.uniform(0.5, 2))) * 2 - 1
    elif kind == 2:  # cloth
        threads = rng.uniform(30, 110)
        value = np.sin(2 * np.pi * threads * x) + np.sin(2 * np.pi * threads * y) + cloud
    elif kind == 3:  # writing
        lines = (y * rng.uniform(40, 90)) % 1 < 0.5
        value = np.where(lines & (cloud + 0.5 * rng.standard_normal(cloud.shape) > 0.3), -2.0, 0.5)
    else:  # tiles
        tiles = rng.uniform(8, 40)
        value = np.where(((x * tiles).astype(int) + (y * tiles).astype(int)) % 2, 1.0, -1.0) + 0.5 * cloud
    spread = value.std() or 1.0
    return np.clip(gray * (1 + rng.uniform(0.08, 0.5) * (value - value.mean()) / spread), 0.01, 0.97)


def _diffuse(gray: np.ndarray) -> dict:
    return {"type": "diffuse", "reflectance": _bitmap(gray)}


def _bitmap(gray: np.ndarray) -> dict:
    values = np.repeat(np.asarray(gray, np.float32)[..., None], 3, axis=2)
    bitmap = mitsuba.Bitmap(np.ascontiguousarray(values))
    return {"type": "bitmap", "bitmap": bitmap, "raw": True, "wrap_mode": "mirror"}


def _skin(rng: Rng) -> dict:
    side = 256
    mottled = cv2.resize(
        rng.standard_normal((20, 20)).astype(np.float32), (side, side), interpolation=cv2.INTER_CUBIC
    )
    gray = rng.uniform(0.15, 0.75) * (1 + rng.uniform(0.0, 0.12) * mottled)
    for place in rng.uniform(0.1, 0.9, rng.integers(0, 4)):  # creases at joints
        gray[:, int(place * side) : int(place * side) + 4] *= 0.75
    return {
        "type": "principled",
        "base_color": _bitmap(np.clip(gray, 0.02, 0.95)),
        "roughness": float(rng.uniform(0.35, 0.8)),
        "specular": float(rng.uniform(0.2, 0.6)),
    }


def _rubber(rng: Rng) -> dict:
    """Silicone, matt or shining; plain, ribbed in its gray, or spotted."""
    side, gray = 256, rng.uniform(0.04, 0.85)
    place = np.linspace(0, 1, side, dtype=np.float32)
    pattern = rng.integers(3)
    value = np.zeros((side, side), np.float32)
    if pattern == 1:
        value[:] = np.sin(2 * np.pi * rng.uniform(4, 25) * place)
    elif pattern == 2:
        value = cv2.resize(rng.standard_normal((24, 24)).astype(np.float32), (side, side))
    base = np.clip(gray * (1 + rng.uniform(0, 0.35) * value), 0.02, 0.95)
    return {
        "type": "principled",
        "base_color": _bitmap(base),
        "roughness": float(rng.uniform(0.15, 0.8)),
        "specular": float(rng.uniform(0.2, 0.8)),
    }


def _tube(name: str, nodes: np.ndarray, radii: np.ndarray, bsdf: dict, folder: Path) -> dict:
    """A swept circle, with a sphere at each end, and at each node of a chain of few links."""
    path = folder / f"{name}.ply"
    _write_mesh(path, nodes, radii)
    found: dict = {name: {"type": "ply", "filename": str(path), "bsdf": bsdf}}
    ends = range(len(nodes)) if len(nodes) < 8 else (0, len(nodes) - 1)
    for k in ends:
        found[f"{name}_{k}"] = {
            "type": "sphere",
            "center": nodes[k].tolist(),
            "radius": float(radii[k]),
            "bsdf": bsdf,
        }
    return found


def _write_mesh(path: Path, nodes: np.ndarray, radii: np.ndarray) -> None:
    """Circles normal to the axis, joined by triangles; place and angle along it are those of textures."""
    steps = np.diff(nodes, axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    if len(nodes) < 8:  # links: each a cone of its own
        pairs = [(k, k + 1, steps[k]) for k in range(len(steps))]
        rings = [(k, step) for a, b, step in pairs for k, step in ((a, step), (b, step))]
        joined = [2 * k for k in range(len(pairs))]
    else:
        ahead = np.vstack([steps[:1], steps[:-1] + steps[1:], steps[-1:]])
        ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
        rings = [(k, ahead[k]) for k in range(len(nodes))]
        joined = list(range(len(nodes) - 1))
    turns = 2 * np.pi * np.arange(AROUND) / AROUND
    rows = []
    for k, step in rings:
        side = np.cross(step, [0.0, 1.0, 0.0] if abs(step[1]) < 0.9 else [1.0, 0.0, 0.0])
        side /= np.linalg.norm(side)
        normal = np.cos(turns)[:, None] * side + np.sin(turns)[:, None] * np.cross(step, side)
        points = nodes[k] + radii[k] * normal
        place = np.full(AROUND, k / (len(nodes) - 1))
        rows.append(np.column_stack([points, normal, place, np.arange(AROUND) / AROUND]))
    near = np.arange(AROUND)
    far = (near + 1) % AROUND
    faces = np.concatenate(
        [
            np.concatenate(
                [
                    np.stack([AROUND * r + near, AROUND * r + far, AROUND * (r + 1) + near], axis=1),
                    np.stack([AROUND * r + far, AROUND * (r + 1) + far, AROUND * (r + 1) + near], axis=1),
                ]
            )
            for r in joined
        ]
    )
    vertices = np.concatenate(rows)
    head = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    head += [f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz", "u", "v")]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    body = [" ".join(f"{value:.6f}" for value in row) for row in vertices]
    body += [f"3 {a} {b} {c}" for a, b, c in faces]
    path.write_text("\n".join(head + body) + "\n")


def _hand(rng: Rng, base: np.ndarray, radius: float, skin: dict, folder: Path) -> dict:
    """A palm behind the finger's base, and three fingers beside it, bent."""
    across = np.array([0.0, rng.uniform(0.5, 1.5), rng.uniform(-1.5, 0.0)])
    palm = (
        base
        + np.array([-0.8, -3.0, -7.0])[:, None] * [1.0, 0.0, 0.0]
        + np.array([[0.4], [1.0], [1.4]]) * across
    )
    found = _tube("palm", palm, radius * rng.uniform((1.1, 1.6, 1.5), (1.5, 2.3, 2.2)), skin, folder)
    bend = rng.uniform(0.5, 1.4)
    for k in range(3):
        angles = np.cumsum(bend * rng.uniform(0.8, 1.2, 3) * [0.8, 1.1, 0.8])
        lengths = np.array([3.6, 2.4, 1.8]) * rng.uniform(0.85, 1.05)
        steps = np.stack([np.cos(angles), np.zeros(3), -np.sin(angles)], axis=1) * lengths[:, None]
        start = base + np.array([-0.6, 1.9 * (k + 1), -0.3 * k])
        nodes = np.vstack([start, start + np.cumsum(steps, axis=0)])
        sizes = radius * rng.uniform(0.8, 0.95) * np.array([1.0, 0.85, 0.7, 0.55])
        found |= _tube(f"other{k}", nodes, sizes, skin, folder)
    return found


def _mount(rng: Rng, base: np.ndarray, radius: float) -> dict:
    """A block behind the exosuit's base that clamps it, and perhaps a strap around the finger."""
    gray = float(rng.uniform(0.05, 0.9))
    half = [rng.uniform(0.5, 1.4), radius * rng.uniform(1.1, 1.8), radius * rng.uniform(0.9, 1.7)]
    place = base + np.array([-half[0] + rng.uniform(-0.1, 0.2), 0, rng.uniform(-0.2, 0.3)])
    bsdf = {"type": "roughplastic", "diffuse_reflectance": {"type": "rgb", "value": gray}, "alpha": 0.2}
    turn = Transform().rotate([0, 1, 0], rng.uniform(-5, 5))
    pose = Transform().translate(place.tolist()) @ turn @ Transform().scale(half)
    found: dict = {"mount": {"type": "cube", "to_world": pose, "bsdf": bsdf}}
    if rng.random() < 0.5:
        low = base[2] - radius - 2.3
        found["strap"] = {
            "type": "cylinder",
            "p0": [float(base[0] - 0.9), 0.0, float(low)],
            "p1": [float(base[0] - 0.9), 0.0, float(base[2])],
            "radius": float(rng.uniform(1.1, 1.3)),
            "bsdf": {
                "type": "twosided",
                "bsdf": _diffuse(np.full((2, 2), rng.uniform(0.05, 0.9), np.float32)),
            },
        }
    return found


def _clutter(rng: Rng) -> dict:
    """Boxes, balls and rods on the backdrop, behind the device."""
    found: dict = {}
    for k in range(rng.integers(6, 16)):
        size = np.exp(rng.uniform(np.log(0.3), np.log(2.0), 3))
        place = [rng.uniform(-4, 14), 1.0 + np.linalg.norm(size) + rng.uniform(0, 2), rng.uniform(-8, 7)]
        gray = rng.uniform(0.04, 0.9)
        surface = _diffuse(
            _printed(rng, gray, 128) if rng.random() < 0.5 else np.full((2, 2), gray, np.float32)
        )
        bsdf = {"type": "twosided", "bsdf": surface}
        kind = ("cube", "sphere", "cylinder")[rng.integers(3)]
        if kind == "cube":
            axis = rng.standard_normal(3)
            turn = Transform().rotate((axis / np.linalg.norm(axis)).tolist(), rng.uniform(0, 180))
            half = size.tolist()
            shape: dict = {"to_world": Transform().translate(place) @ turn @ Transform().scale(half)}
        elif kind == "sphere":
            shape = {"center": place, "radius": min(1.2, float(size[0]))}
        else:
            reach = rng.normal(0, 2.5, 3) * [1, 0, 1]
            shape = {
                "p0": (place - reach).tolist(),
                "p1": (place + reach).tolist(),
                "radius": min(1.0, float(size[0])),
            }
        found[f"thing{k}"] = {"type": kind, "bsdf": bsdf} | shape
    return found


def _cable(rng: Rng, folder: Path) -> dict:
    """A thin cable through the picture, before or behind the device."""
    y = rng.uniform(-2.5, -1.2) if rng.random() < 0.5 else rng.uniform(1.3, 2.5)
    ends = rng.uniform((-3, -7), (13, 6), (4, 2))
    ends[0] = [rng.uniform(-3, 13), rng.choice([-9.0, 8.0])]
    t = np.linspace(0, 1, 48)[:, None]
    weights = np.hstack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3])
    line = weights @ ends
    nodes = np.column_stack([line[:, 0], np.full(48, y), line[:, 1]])
    bsdf = {
        "type": "roughplastic",
        "diffuse_reflectance": {"type": "rgb", "value": float(rng.uniform(0.03, 0.8))},
    }
    return _tube("cable", nodes, np.full(48, rng.uniform(0.08, 0.22)), bsdf, folder)


def _exposed(rng: Rng, kind: str, linear: np.ndarray) -> UInt8[np.ndarray, "height width"]:
    """Noise of few light paths removed, exposure, sRGB's curve, blur, sensor noise, JPEG."""
    gain = rng.uniform(0.6, 1.1) / max(np.quantile(linear, 0.95), 1e-6)
    value = np.clip(linear * gain, 0, 1)
    curve = np.where(value < 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)
    image = cv2.fastNlMeansDenoising((255 * curve + 0.5).astype(np.uint8), h=4)
    if kind == "cluttered":
        length, angle = rng.uniform(0, 4), rng.uniform(0, np.pi)
        kernel = np.zeros((9, 9), np.float32)
        for step in np.linspace(-0.5, 0.5, 33):
            kernel[round(4 + length * step * np.sin(angle)), round(4 + length * step * np.cos(angle))] += (
                1 / 33
            )
        image = cv2.filter2D(image, -1, kernel, borderType=cv2.BORDER_REFLECT)
        image = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.3, 1.0))
    noisy = image + rng.normal(0, rng.uniform(0.5, 4.0), image.shape)
    image = np.clip(noisy + 0.5, 0, 255).astype(np.uint8)
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(60, 96))])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE))

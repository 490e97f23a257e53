"""What is installed here, what of it works, and what is missing: the facts behind `exosight doctor`."""

import os
import platform
import shutil
from dataclasses import dataclass
from importlib import import_module, metadata
from pathlib import Path

from packaging.requirements import Requirement

from exosight import __version__
from exosight.cpu import cores

GIVES = {
    "train": "training networks and exporting them as ONNX",
    "cluster": "datasets on several processes and machines",
    "compare": "the programs that validation compares with",
    "test": "the tests",
    "docs": "the documentation site",
    "gym": "the Gymnasium environment",
    "agents": "agents that learn in it, for its benchmark",
    "lab": "the local web page",
    "ros": "recordings of ROS",
    "lerobot": "datasets of LeRobot",
}
"""What an extra of the package is for."""

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


@dataclass(frozen=True)
class Package:
    """One package that exosight asks for."""

    name: str
    wanted: str
    """Versions that will do, such as ">=2.0"."""
    installed: str | None
    fits: bool
    """Installed, in a version that will do."""


@dataclass(frozen=True)
class Extra:
    """A set of packages for one purpose."""

    name: str
    gives: str
    missing: tuple[str, ...]
    """Packages that are not there, or in another version than asked for."""


@dataclass(frozen=True)
class Health:
    """What was found."""

    version: str
    python: str
    system: str
    core: tuple[Package, ...]
    extras: tuple[Extra, ...]
    jax: str
    """What JAX computes on, or why it does not."""
    energies: str
    """How the solver evaluates energies."""
    torch: str
    """What PyTorch trains on, or why it does not."""
    estimator: str
    """Whether the network that comes with the package answers."""
    cache: str
    """Folder of compiled code, and whether it can be written."""
    cores: int
    """That this process may use."""
    memory: float | None
    """Of the machine [GiB]; None where the system does not tell."""
    disk: float
    """Free in the present folder [GiB]."""
    browser: str | None
    """Chromium or Chrome, which the tests of web pages drive."""
    cameras: tuple[str, ...]
    """Video devices."""
    works: bool
    """The core is complete, and the shipped network answers."""


def examine() -> Health:
    """Look at this installation; imports JAX and PyTorch, which takes some seconds."""
    core, extras = packages(metadata.requires("exosight") or [])
    estimator, answers = _try_estimator()
    return Health(
        version=__version__,
        python=f"{platform.python_version()} ({platform.python_implementation()})",
        system=f"{platform.system()} {platform.release()}, {platform.machine()}",
        core=core,
        extras=extras,
        jax=_try_jax(),
        energies=_try_programs(),
        torch=_try_torch(),
        estimator=estimator,
        cache=_cache(),
        cores=cores(),
        memory=_memory(),
        disk=shutil.disk_usage(Path.cwd()).free / 2**30,
        browser=next((found for name in BROWSERS if (found := shutil.which(name))), None),
        cameras=tuple(sorted(str(path) for path in Path("/dev").glob("video*"))),
        works=answers and all(package.fits for package in core),
    )


def packages(requirements: list[str]) -> tuple[tuple[Package, ...], tuple[Extra, ...]]:
    """The core's packages, and the extras, of a distribution's requirements as its metadata writes them."""
    core, extras = [], {}
    for text in requirements:
        requirement = Requirement(text)
        found = _installed(requirement)
        names = [name for name in _extras_of(text) if name]
        if not names:
            core.append(found)
        for name in names:
            extras.setdefault(name, []).append(found)
    return tuple(core), tuple(
        Extra(name, GIVES.get(name, ""), tuple(package.name for package in own if not package.fits))
        for name, own in extras.items()
    )


def _extras_of(text: str) -> list[str]:
    return [part.strip(" \"'()") for part in text.partition(";")[2].split("extra ==")[1:]]


def _installed(requirement: Requirement) -> Package:
    try:
        version = metadata.version(requirement.name)
    except metadata.PackageNotFoundError:
        version = None
    fits = version is not None and requirement.specifier.contains(version, prereleases=True)
    return Package(requirement.name, str(requirement.specifier), version, fits)


def _try_jax() -> str:
    # A look must not take the GPU's memory, which JAX otherwise does at once.
    os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")
    try:
        devices = import_module("jax").devices()
    except Exception as error:  # a broken driver raises anything
        return f"does not work: {_first_line(error)}"
    kinds = [(device.platform, device.device_kind) for device in devices]
    return ", ".join(where if where == kind else f"{where}: {kind}" for where, kind in kinds)


def _try_programs() -> str:
    try:
        from exosight.scalar_program import obstacle

        why = obstacle()
    except Exception as error:
        why = _first_line(error)
    return f"by XLA only: {why}" if why else "by scalar programs on a CPU, by XLA elsewhere"


def _try_torch() -> str:
    try:
        torch = import_module("torch")
        if torch.cuda.is_available():
            return ", ".join(
                f"cuda: {torch.cuda.get_device_name(i)}" for i in range(torch.cuda.device_count())
            )
    except ModuleNotFoundError:
        return "not installed"
    except Exception as error:
        return f"does not work: {_first_line(error)}"
    return "cpu"


def _try_estimator() -> tuple[str, bool]:
    try:
        import numpy as np

        from exosight.control.estimator import SHIPPED_MODELS, OnnxEstimator

        models = dict.fromkeys(SHIPPED_MODELS.values())
        for path in models:
            estimator = OnnxEstimator.load(path)
            estimator.read(np.full((1, *estimator.card.schema.image_size), 200, np.uint8))
    except Exception as error:
        return f"does not work: {_first_line(error)}", False
    return f"{', '.join(path.name for path in models)} answer", True


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:200]


def _cache() -> str:
    folder = os.environ.get("JAX_COMPILATION_CACHE_DIR", "")
    if not folder:
        return "none; every process compiles anew"
    path = Path(folder)
    there = next(part for part in (path, *path.parents) if part.exists())
    if not os.access(there, os.W_OK | os.X_OK):
        return f"{path}, which cannot be written; every process compiles anew"
    size = sum(file.stat().st_size for file in path.rglob("*") if file.is_file()) if path.is_dir() else 0
    return f"{path}, {size / 2**20:.1f} MiB"


def _memory() -> float | None:
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    except (ValueError, OSError, AttributeError):
        return None

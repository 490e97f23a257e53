"""Write docs/licences.md: what exosight stands on, how large each part is, and under which licence it comes.

From the metadata of what is installed beside this interpreter, so run it where all extras are:

    .venv/bin/python tools/dependencies.py
"""

import re
import sys
import tomllib
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "licences.md"
MIB = 2**20
CORE = "core"

ELSEWHERE = {"mlcroissant": "Apache-2.0, says its repository"}
"""Licences of packages whose files state none."""


def main() -> None:
    """Look at every distribution that the core and the extras need, and write the page."""
    wanted = direct()
    needed = {extra: closure(names) for extra, names in wanted.items()}
    missing = sorted({name for names in wanted.values() for name in names if distribution(name) is None})
    if missing:
        sys.exit(f"dependencies: not installed: {', '.join(missing)}; run make test first")
    PAGE.write_text(page(wanted, needed), encoding="utf-8")
    print(f"wrote {PAGE}")


def direct() -> dict[str, list[str]]:
    """The packages that pyproject.toml names, by extra."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    listed = {CORE: project["dependencies"], **project["optional-dependencies"]}
    return {
        extra: [canonicalize_name(Requirement(text).name) for text in texts]
        for extra, texts in listed.items()
    }


def closure(names: list[str]) -> set[str]:
    """These packages and all that they need here, as far as installed."""
    found: set[str] = set()
    waiting = list(names)
    while waiting:
        name = waiting.pop()
        own = distribution(name)
        if name in found or own is None:
            continue
        found.add(name)
        for text in own.requires or []:
            requirement = Requirement(text)
            if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
                waiting.append(canonicalize_name(requirement.name))
    return found


def distribution(name: str) -> metadata.Distribution | None:
    """What is installed under a name, or None."""
    try:
        return metadata.distribution(name)
    except metadata.PackageNotFoundError:
        return None


def licence(own: metadata.Distribution) -> str:
    """The licence that a package states, as short as it states it."""
    meta = own.metadata
    stated = meta.get("License-Expression") or ""
    if not stated:
        classified = [c for c in meta.get_all("Classifier") or [] if c.startswith("License ::")]
        stated = ", ".join(c.rsplit(" :: ", 1)[1] for c in classified)
    if stated in ("", "OSI Approved"):
        texts = [file for file in own.files or [] if file.name.upper().startswith("LICENSE")]
        written = meta.get("License") or (texts[0].read_text() if texts else "")
        stated = next((line.strip() for line in written.splitlines() if line.strip()), "")
    stated = stated or ELSEWHERE.get(canonicalize_name(own.name), "not stated")
    return re.sub(r"\s+", " ", stated)[:60].replace("|", "/")


def size(own: metadata.Distribution) -> int:
    """Bytes of its files on disk."""
    paths = [Path(str(own.locate_file(file))) for file in own.files or []]
    return sum(path.stat().st_size for path in paths if path.is_file() and path.suffix != ".pyc")


def page(wanted: dict[str, list[str]], needed: dict[str, set[str]]) -> str:
    """The page as Markdown."""
    known = {name: distribution(name) for names in needed.values() for name in names}
    sizes = {name: size(own) for name, own in known.items() if own is not None}
    lines = [
        "# Dependencies: sizes and licences",
        "",
        "exosight itself has the MIT licence. Below is all that it stands on, at the versions of",
        "`constraints.txt`, the lock file that `make` installs from.",
        "",
        "Made by `python tools/dependencies.py` from the packages' own metadata. Sizes are those of the",
        "files on disk (Linux, x86-64, PyTorch for CPUs; the default build with CUDA takes several GB more).",
        "",
        "## Extras",
        "",
        "`pip install 'exosight[train,cluster]'` adds them to the core.",
        "",
        "| | packages asked for | MiB | of these beyond the core |",
        "| --- | --- | --- | --- |",
    ]
    for extra, names in wanted.items():
        total = sum(sizes[name] for name in needed[extra])
        beyond = sum(sizes[name] for name in needed[extra] - needed[CORE])
        last = "" if extra == CORE else f"{beyond / MIB:,.0f}"
        lines.append(f"| {extra} | {', '.join(sorted(names))} | {total / MIB:,.0f} | {last} |")
    lines += [
        "",
        "## Licences",
        "",
        "| package | version | licence | MiB | needed by |",
        "| --- | --- | --- | --- | --- |",
    ]
    for name in sorted(sizes):
        own = known[name]
        assert own is not None
        by = [extra for extra in wanted if name in needed[extra]]
        by = [CORE] if CORE in by else by
        direct_ = "**" if any(name in names for names in wanted.values()) else ""
        lines.append(
            f"| {direct_}{name}{direct_} | {own.version.partition('+')[0]} | {licence(own)} | "
            f"{sizes[name] / MIB:,.1f} | {', '.join(by)} |"
        )
    lines += ["", "Bold: asked for by exosight itself; the others come with these."]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()

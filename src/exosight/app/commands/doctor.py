"""`exosight doctor`: what is installed, what works, what is missing."""

from dataclasses import asdict

from exosight.app.commands.options import Json
from exosight.app.console import check_json_target, say, show, write_json
from exosight.errors import InputError
from exosight.evaluation.tables import Column, Table


def doctor(json: Json = None) -> None:
    """Tell which version this is, what it runs on, which extras are missing and what they would give.

    Missing extras are no fault. The exit code is 2 if something is wrong with the core: a package that is
    missing or of the wrong version, or a shipped network that does not answer.

    Example:
      exosight doctor

    Args:
        json: write what was found as JSON to a new file, or to stdout with "-", instead of tables
    """
    check_json_target(json)
    from exosight.app.doctor import examine

    found = examine()
    if json is not None:
        write_json(asdict(found), json)
    else:
        memory = "unknown" if found.memory is None else f"{found.memory:.1f} GiB"
        machine = (
            ("exosight", found.version),
            ("Python", found.python),
            ("system", found.system),
            ("JAX computes on", found.jax),
            ("energies are evaluated", found.energies),
            ("PyTorch trains on", found.torch),
            ("shipped network", found.estimator),
            ("compiled code", found.cache),
            ("cores", str(found.cores)),
            ("memory", memory),
            ("free disk here", f"{found.disk:.1f} GiB"),
            ("browser for tests", found.browser or "none"),
            ("cameras", ", ".join(found.cameras) or "none"),
        )
        show(Table("machine", "This installation", (Column("what"), Column("found")), machine))
        core = tuple(
            (each.name, each.wanted, each.installed or "–", "yes" if each.fits else "NO")
            for each in found.core
        )
        show(
            Table(
                "core",
                "Core packages",
                (Column("package"), Column("wanted"), Column("installed"), Column("ok")),
                core,
            )
        )
        extras = tuple((each.name, each.gives, ", ".join(each.missing) or "nothing") for each in found.extras)
        show(Table("extras", "Extras", (Column("extra"), Column("gives"), Column("missing")), extras))
        absent = [each.name for each in found.extras if each.missing]
        if absent:
            say(f"to add one: pip install 'exosight[{absent[0]}]'")
    if not found.works:
        wrong = [each.name for each in found.core if not each.fits]
        what = f"wrong or missing: {', '.join(wrong)}" if wrong else f"the shipped network {found.estimator}"
        raise InputError(f"doctor: {what}; install exosight again with pip install --force-reinstall")

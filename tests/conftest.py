"""Every jaxtyping annotation in the package is checked while the tests run, and compiled code is shared.

Most of the tests' time is JAX compiling; the processes of one run, and later runs, share what it made, and
XLA's older code generator, without optimisation, makes it in a quarter of the time and runs a fifth slower
(`tests/exosuit/test_simulation.py` compares it with what users have). A process that has grown large gives
its own back when a file of tests is done: kept to the end it came to 5 GB.
"""

import ast
import ctypes
import gc
import os
import sys
from collections import Counter
from importlib.metadata import version
from importlib.util import cache_from_source
from pathlib import Path

import _pytest.runner
import hypothesis
import pytest
from jaxtyping import _import_hook, install_import_hook

os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(Path(__file__).parents[1] / ".pytest_cache" / "jax"))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
if version("jaxlib").startswith("0.10."):  # a flag that a version does not know ends the process
    quickly = "--xla_cpu_use_fusion_emitters=false --xla_backend_optimization_level=0"
    os.environ.setdefault("XLA_FLAGS", quickly)

# How long an example takes is not what a test asserts, and says little on a busy machine. Every run draws
# other examples, so that few a run are many in the end; but continuous integration always the same ones, so
# that what it says of a commit is so again.
hypothesis.settings.register_profile(
    "exosight", deadline=None, max_examples=25, derandomize="CI" in os.environ
)
hypothesis.settings.load_profile("exosight")

# The hook names compiled files of all that is imported meanwhile as its own: every process compiled 2000
# modules of other packages anew; and those that tests start, the package, where Python was to write nothing.
_of_checked = _import_hook._optimized_cache_from_source


def _compiled_file(typechecker: str, path: str, *rest: object) -> str:
    # Checked code must never be found by a process without the hook, wherever the package lies.
    of_package = "exosight" in Path(path.rpartition("site-packages")[2]).parts
    return _of_checked(typechecker, path, *rest) if of_package else cache_from_source(path, *rest)


_import_hook._optimized_cache_from_source = _compiled_file


class _OfModulesAndClasses(_import_hook.JaxtypingTransformer):
    """Functions within functions are not checked: each call of the outer one would prepare them anew."""

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.FunctionDef:
        body, node.body = node.body, []
        super().visit_FunctionDef(node)
        node.body = body
        return node


_import_hook.JaxtypingTransformer = _OfModulesAndClasses
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
install_import_hook("exosight", "beartype.beartype")

# Python 3.11 and 3.12 are slow at some depths of the call stack, and tests lie deep below pytest.
from exosight.call_stack import with_room_for_frames  # noqa: E402 - after the hook

_pytest.runner.runtestprotocol = with_room_for_frames(_pytest.runner.runtestprotocol)

# Tracing makes so many objects that collecting garbage as often as usual takes 7 % of the time.
gc.set_threshold(50_000, 20, 50)

LONGEST = (
    *("test_docs.py", "app/test_study.py", "test_examples.py", "dataset/test_simulation.py"),
    *("exosuit/test_index.py", "control/test_any_system.py", "mechanics/test_neighbours.py"),
    *("test_kill.py", "mechanics/test_timestep.py", "exosuit/test_design.py", "app/test_torchrun.py"),
    *("mechanics/test_convergence.py", "app/test_bench.py", "learning/test_parallel.py"),
)
"""Files that take longest, for few tests: begun last, one would keep a process when all else is done."""

LARGE = 2.5e9
"""Memory [bytes] above which a process gives back what JAX compiled."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Whole files in the order in which processes take them: those first, then those of many tests."""
    tests = Counter(item.path for item in items)
    items.sort(key=lambda item: (not str(item.path).endswith(LONGEST), -tests[item.path], str(item.path)))


def pytest_collection_finish() -> None:
    """What has been imported stays, so collections need not look at it."""
    gc.freeze()


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """Give it back after the last test of a file; elsewhere than on Linux with glibc nothing is done."""
    file_is_done = nextitem is None or nextitem.path != item.path
    if file_is_done and sys.platform == "linux" and _resident() > LARGE:
        import jax  # after the settings above, which it reads

        jax.clear_caches()
        gc.collect()
        libc = ctypes.CDLL(None)
        if hasattr(libc, "malloc_trim"):
            libc.malloc_trim(0)


def _resident() -> int:
    """Memory of this process [bytes]."""
    pages = Path("/proc/self/statm").read_text().split()[1]
    return int(pages) * os.sysconf("SC_PAGE_SIZE")

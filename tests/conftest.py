"""Every jaxtyping annotation in the package is checked while the tests run, and compiled code is shared.

Most of the tests' time is JAX compiling; the processes of one run, and later runs, share what it made.
"""

import os
from pathlib import Path

import hypothesis
from jaxtyping import install_import_hook

os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(Path(__file__).parents[1] / ".pytest_cache" / "jax"))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.5")

# How long an example takes is not what a test asserts, and says little on a busy machine.
hypothesis.settings.register_profile("exosight", deadline=None)
hypothesis.settings.load_profile("exosight")

install_import_hook("exosight", "beartype.beartype")

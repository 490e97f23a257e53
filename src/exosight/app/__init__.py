"""What a person runs: the command line, the study and its report.

main             the command line's door
commands         one module a verb
study, pipeline  the stages from a dataset to a report, and the steps that they share with single commands
report, …        sections of text, tables and figures as one HTML page
"""

import os
from pathlib import Path

# JAX reads these when it is imported, below this package: compiled code is kept on disk, so that only the
# first run on a machine waits for the compiler.
_CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "exosight" / "jax"
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(_CACHE))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.5")

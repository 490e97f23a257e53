"""Command line, study and report.

main, options    the command line: commands, their options, error messages
commands         one module a command: its options, its help, and the call of what does the work
pipeline         the steps from a dataset to a trained network that commands and study share
evaluation       a network evaluated on a dataset
control_command  the closed loop's trials
control_figures  figures of trials and of the stress test
study, …         all of it; study_config holds its presets, study_report fills its report
report, …        sections of text, tables and figures as one HTML page; chapters holds the study's sections
console, output  what is shown; where results are written
"""

import os
from pathlib import Path

# JAX reads these when it is imported, below this package: compiled code is kept on disk, so that only the
# first run on a machine waits for the compiler.
_CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "exosight" / "jax"
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(_CACHE))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.5")
# On a slow machine the compiler would otherwise ask users to report that it is slow.
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")

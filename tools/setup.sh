#!/bin/sh
# Make .venv and install exosight with the extras named in $1, at the pinned versions.
# Says in one line what is missing when a step fails.
set -u
fail() { echo "setup: $1" >&2; exit 1; }

python=${PYTHON:-python3}
command -v "$python" >/dev/null 2>&1 || fail "'$python' was not found; install Python 3.11 or newer, or run 'make PYTHON=/path/to/python ...'"
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
    fail "'$python' is $("$python" --version 2>&1), exosight needs Python 3.11 or newer; run 'make PYTHON=python3.11 ...' if you have it"
[ -x .venv/bin/python ] || "$python" -m venv .venv ||
    fail "'$python -m venv' failed; on Debian and Ubuntu run 'apt install python3-venv' first"
.venv/bin/python -m pip --version >/dev/null 2>&1 || fail ".venv has no pip; run 'make clean' and try again"
echo "setup: installing into .venv (PyTorch and JAX are large; this can take minutes) ..."
.venv/bin/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt -e ".[$1]" ||
    fail "pip could not install the pinned packages of constraints.txt; see its message above (network? disk space: 3 GiB are needed)"
# What pip would compile one file after the other, on all cores; some packages hold templates that are no Python.
.venv/bin/python -m compileall -qq -j 0 .venv/lib >/dev/null 2>&1
for extra in $(echo "$1" | tr ',' ' '); do touch ".venv/ready-$extra"; done

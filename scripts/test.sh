#!/bin/sh
# The same set-up with the test extra, then the whole default test suite. Arguments go to pytest.
EXTRAS="${EXTRAS:-test}"
. "$(dirname "$0")/setup.sh"
export OPENBLAS_NUM_THREADS=1  # workers share two cores; two more run while others wait for pages and processes
# Workers that begin in a fresh checkout would each compile all test files: these two halves are compiled once.
collect() { .venv/bin/python -m pytest --collect-only -qq "$@" >/dev/null 2>&1 || true; }  # the suite tells what fails
if [ ! -e .venv/.collected ]; then
    collect tests/[a-k]*/ & half=$!
    collect tests/[l-z]*/ tests/test_*.py
    wait "$half"
    touch .venv/.collected
fi
exec .venv/bin/python -m pytest -n 4 --dist worksteal "$@"

#!/bin/sh
# The same set-up with the test extra, then the whole default test suite. Arguments go to pytest.
EXTRAS="${EXTRAS:-test}"
. "$(dirname "$0")/setup.sh"
export OPENBLAS_NUM_THREADS=1  # two workers share the cores
exec .venv/bin/python -m pytest -n 2 --dist worksteal "$@"

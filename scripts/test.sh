#!/bin/sh
# The same set-up with the test extra, then the whole default test suite. Arguments go to pytest.
EXTRAS="${EXTRAS:-test}"
. "$(dirname "$0")/setup.sh"
export OPENBLAS_NUM_THREADS=1  # workers share two cores; a third runs while others wait for pages and processes
exec .venv/bin/python -m pytest -n 3 --dist worksteal "$@"

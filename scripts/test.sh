#!/bin/sh
# The same set-up with the test extra, then the whole default test suite. Arguments go to pytest.
EXTRAS=test
. "$(dirname "$0")/setup.sh"
exec .venv/bin/python -m pytest -n 2 --dist worksteal "$@"

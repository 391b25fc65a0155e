#!/bin/sh
# The main job on a machine that has only Python: set up, then the point-to-point experiment into out/.
. "$(dirname "$0")/setup.sh"
exec .venv/bin/python scripts/point_to_point.py

# Sourced by run.sh and test.sh: makes .venv in the project's root and installs ccpin with the extras in $EXTRAS.
# Needs Python 3.10 or newer with venv; nothing else.
set -eu
cd "$(dirname "$0")/.."
PYTHON="${PYTHON:-python3}"
"$PYTHON" -c 'import sys; sys.exit(sys.version_info < (3, 10))' || {
    echo "ccpin needs Python 3.10 or newer; set PYTHON to one" >&2
    exit 1
}
unset PYTHONDONTWRITEBYTECODE  # hundreds of processes are started: what one has compiled serves all
export PYTHONPYCACHEPREFIX="$PWD/.venv/pycache"
[ -x .venv/bin/python ] || "$PYTHON" -m venv .venv
stamp=".venv/.installed-${EXTRAS:-plain}"
# --no-compile: most of 14,000 files are never imported, and what is is compiled then, on both cores
if [ ! -e "$stamp" ] || [ -n "$(find pyproject.toml native -newer "$stamp")" ]; then
    .venv/bin/python -m pip install --quiet --no-compile --disable-pip-version-check -e ".${EXTRAS:+[$EXTRAS]}"
    touch "$stamp"
    .venv/bin/python -c '
import ccpin
backend = ccpin.backend()
if backend.name == "numpy":
    print(f"note: ccpin computes with NumPy: {backend.reason}")'
fi

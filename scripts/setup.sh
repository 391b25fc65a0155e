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
install() { .venv/bin/python -m pip install --quiet --no-compile --disable-pip-version-check "$@"; }
if [ ! -e "$stamp" ] || [ -n "$(find pyproject.toml native -newer "$stamp")" ]; then
    rm -rf .venv/wheel src/ccpin/native/_core.*.so
    version="$(sed -n 's/^version = "\(.*\)"$/\1/p' pyproject.toml)"
    # A wheel of the same native/ spares the compiler: from dist/, or from the index that CCPIN_INDEX names (whom you
    # trust is yours to say: a wheel's digest is what it says of itself). Else the core is built.
    [ -n "${CCPIN_INDEX:-}" ] && from="--index-url $CCPIN_INDEX" || from="--no-index"
    if .venv/bin/python -m pip download --quiet --disable-pip-version-check --no-deps --only-binary :all: $from --find-links dist \
        --dest .venv/wheel "ccpin==$version" 2>/dev/null &&
        .venv/bin/python native/fitting.py .venv/wheel/*.whl src/ccpin/native; then
        install "scikit-build-core>=0.10"
        install --no-build-isolation -C wheel.cmake=false -C wheel.py-api=py3 -e ".${EXTRAS:+[$EXTRAS]}"
    else
        install -e ".${EXTRAS:+[$EXTRAS]}"
    fi
    touch "$stamp"
    .venv/bin/python -c '
import ccpin
backend = ccpin.backend()
if backend.name == "numpy":
    print(f"note: ccpin computes with NumPy: {backend.reason}")'
fi

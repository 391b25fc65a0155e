"""Ask the compiled core what it must refuse, under AddressSanitizer and UndefinedBehaviorSanitizer.

    python scripts/fuzz_native.py [--examples 200] [--seed 0] [--folder build/fuzz]

Builds the core with both sanitizers into a folder of its own, then runs itself again with their library loaded first:
random mechanisms, NaN, wrong sizes, singular and unreachable q through every method, and specifications and runs with
missing keys, wrong lengths and indices out of range, which must raise ValueError. A sanitizer's finding, a crash or
another error ends the process with a status other than 0. Needs CMake, Ninja and nanobind beside a compiler.
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import os
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
FLAGS = "-fsanitize=address,undefined;-fno-sanitize-recover=undefined;-fno-omit-frame-pointer;-O1;-fno-inline"
FAR = 9.0


def build(folder: Path) -> Path:
    """The package beside a core with sanitizers, in a folder of its own.

    Raises:
        SystemExit: Something to build with is missing.
    """
    nanobind = subprocess.run([sys.executable, "-m", "nanobind", "--cmake_dir"], capture_output=True, text=True)
    if nanobind.returncode:
        raise SystemExit("fuzz_native needs nanobind: pip install nanobind cmeel-eigen")
    configure = ["cmake", "-G", "Ninja", "-S", str(ROOT / "native"), "-B", str(folder / "build")]
    configure += ["-DCMAKE_BUILD_TYPE=Debug", f"-DCCPIN_FLAGS={FLAGS}", f"-DPython_EXECUTABLE={sys.executable}"]
    configure += [f"-Dnanobind_DIR={nanobind.stdout.strip()}"]
    for command in (configure, ["cmake", "--build", str(folder / "build")]):
        try:
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        except FileNotFoundError:
            raise SystemExit("fuzz_native needs CMake and Ninja") from None
        except subprocess.CalledProcessError:
            raise SystemExit("the core does not build with sanitizers: does the compiler bring libasan?") from None
    package = folder / "package" / "ccpin"
    package.parent.mkdir(exist_ok=True)
    for name in (path.relative_to(ROOT / "src" / "ccpin") for path in (ROOT / "src" / "ccpin").rglob("*.py")):
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).write_bytes((ROOT / "src" / "ccpin" / name).read_bytes())
    name = "_core" + sysconfig.get_config_var("EXT_SUFFIX")
    (package / "native" / name).write_bytes((folder / "build" / name).read_bytes())
    return package.parent


def libraries() -> str:
    """The sanitizers' shared libraries, as the compiler finds them.

    Raises:
        SystemExit: It has none.
    """
    compiler = os.environ.get("CXX", "c++")
    found = []
    for name in ("libasan.so", "libubsan.so", "libstdc++.so"):
        path = subprocess.run([compiler, f"-print-file-name={name}"], capture_output=True, text=True).stdout.strip()
        if not Path(path).is_file():
            raise SystemExit(f"{compiler} has no {name}: install the sanitizers' libraries (Debian: libasan, libubsan)")
        found.append(path)
    return ":".join(found)


def main() -> None:
    """Build, run under the sanitizers, and say how it went."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--examples", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "fuzz")
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.inside:
        raise SystemExit(fuzz(options.examples, options.seed))
    options.folder.mkdir(parents=True, exist_ok=True)
    preload, package = libraries(), build(options.folder.resolve())
    environment = os.environ | {
        "LD_PRELOAD": preload,
        "ASAN_OPTIONS": "detect_leaks=0:abort_on_error=0",
        "UBSAN_OPTIONS": "print_stacktrace=1",
        "PYTHONPATH": os.pathsep.join([str(package), str(ROOT)]),
        "OPENBLAS_NUM_THREADS": "1",
        "CCPIN_BACKEND": "native",
    }
    counts = ["--examples", str(options.examples), "--seed", str(options.seed)]
    command = [sys.executable, __file__, "--inside", *counts]
    raise SystemExit(subprocess.run(command, env=environment, check=False).returncode)


def fuzz(examples: int, seed: int) -> int:
    """Random mechanisms and their specifications spoilt, until one is wrong; how many were asked goes to stdout."""
    from hypothesis import HealthCheck, given, settings
    from hypothesis import seed as seeded
    from hypothesis import strategies as st

    import ccpin
    from ccpin.native._core import Kernel
    from ccpin.native.specification import specification
    from tests.support.strategies import mechanisms

    asked = {"methods": 0, "refused": 0, "taken": 0}

    @seeded(seed)
    @settings(max_examples=examples, deadline=None, database=None, suppress_health_check=list(HealthCheck))
    @given(mechanisms(), st.integers(0, 2**32 - 1))
    def one(drawn: Any, draw: int) -> None:
        mechanism, rng = ccpin.load(drawn.description), np.random.default_rng(draw)
        if rng.random() < 0.5:
            names = [name for name in mechanism.tree.names if rng.random() < 0.5]
            with contextlib.suppress(ccpin.errors.CcpinError):
                mechanism = ccpin.load(drawn.description, actuated=names)
        numbers = specification(mechanism)
        kernel = Kernel(numbers)
        asked["methods"] += ask_everything(kernel, numbers, rng)
        for _ in range(20):
            spoilt = copy.deepcopy(numbers)
            spoil(spoilt, rng)
            try:
                other = Kernel(spoilt)
            except ValueError:
                asked["refused"] += 1
                continue
            asked["taken"] += 1
            ask_everything(other, spoilt, rng)

    one()
    print(", ".join(f"{count} {name}" for name, count in asked.items()))
    return 0


def ask_everything(kernel: Any, numbers: dict[str, Any], rng: np.random.Generator) -> int:
    """Every method with sound arguments, then with some of them spoilt; returns how many calls that made."""
    n_q, n, nv = (int(numbers[key]) for key in ("n_q", "n", "nv"))
    motors = n if numbers["direct"] else len(numbers["motors"])
    near = np.array(numbers["reference"], dtype=np.float64)
    calls = 0
    for size in (0.0, 0.1, FAR):
        q = _alpha(numbers) + size * rng.normal(size=n_q)
        v, a, u = rng.normal(size=n), rng.normal(size=n), rng.normal(size=motors)
        Q, V, A, U = (np.tile(x, (3, 1)) for x in (q, v, a, u))
        singles = {
            "constraints": (near,), "constraint_rate": (near, rng.normal(size=nv)), "rcond": (near,),
            "sigma": (q, near), "closed_point": (near, q), "terms": (near, v, q), "gravity": (near, q),
            "forward_dynamics": (near, v, u, q), "generalized_force": (near, v, a, q), "energy": (near, v, q),
            "inverse_dynamics": (near, v, a, q), "transmission": (near, q), "constraint_forces": (near, v, u, q),
            "generalized_force_derivatives": (near, v, a, q), "forward_dynamics_derivatives": (near, v, u, q),
            "sigma_many": (Q, near, 2), "terms_many": (Q, V, near, 2), "forward_dynamics_many": (Q, V, U, near, 2),
            "generalized_force_many": (Q, V, A, near, 2), "inverse_dynamics_many": (Q, V, A, near, 2),
            "forward_dynamics_derivatives_many": (Q, V, U, near, 2),
        }  # fmt: skip
        for name, arguments in singles.items():
            getattr(kernel, name)(*arguments)
            spoilt = list(arguments)
            k = int(rng.integers(len([x for x in spoilt if isinstance(x, np.ndarray)])))
            spoilt[k] = _spoilt_array(spoilt[k], rng)
            with contextlib.suppress(TypeError):  # None where an array must be
                getattr(kernel, name)(*spoilt)
            calls += 2
    calls += _ask_for_runs(kernel, near, n_q, n, rng)
    return calls


def _ask_for_runs(kernel: Any, near: np.ndarray, n_q: int, n: int, rng: np.random.Generator) -> int:
    """Short runs with each integrator, and with a spoilt law, run or tableau."""
    from ccpin.simulation.in_core import TABLEAUX

    zero = np.zeros(n * n).tolist()
    law = {"kind": str(rng.choice(["pd", "pd_gravity", "computed_torque", "pd_plus"])), "start": [0.0] * n_q,
           "breaks": [], "degree": 0, "coefficients": [], "K_p": zero, "K_v": zero, "constant": [0.0] * n}  # fmt: skip
    run = {"times": np.linspace(0.0, 0.01, 3), "start": np.zeros(n_q + n), "rtol": 1e-6, "atol": 1e-8,
           "max_step": np.inf, "singular_rcond": 1e-7, "goal": [], "band": 0.0, "speed": 0.0, "hold": 0.0}  # fmt: skip
    for tableau in TABLEAUX.values():
        kernel.simulate(near, law, run, tableau)
        arguments = [copy.deepcopy(each) for each in (law, run, dict(tableau))]
        spoil(arguments[int(rng.integers(3))], rng)
        with contextlib.suppress(ValueError):
            kernel.simulate(near, *arguments)
    return 2 * len(TABLEAUX)


def _alpha(numbers: dict[str, Any]) -> np.ndarray:
    """q at the reference, whole joints only: components get 0, which is as good as any number."""
    reference, q = np.array(numbers["reference"]), np.zeros(numbers["n_q"])
    for _, joint, component, (start, _, size, _), _ in numbers["coordinates"]:
        if component < 0:
            window = numbers["joints"][joint - 1][2]
            q[start : start + size] = reference[window[0] : window[0] + size]
    return q


def _spoilt_array(array: np.ndarray, rng: np.random.Generator) -> Any:
    """An array of another size, with NaN in it, of another kind, or none at all."""
    poisoned = array.copy()
    if poisoned.size:
        poisoned.flat[int(rng.integers(poisoned.size))] = rng.choice([np.nan, np.inf, 1e300])
    others = [poisoned, array[:-1], np.append(array, 1.0), array[None], array.astype(str), None, "text", [], 3.0,
              np.zeros((2, 2, 2, 2)), array[..., ::-1], array.astype(np.float32), np.empty((0, 0))]  # fmt: skip
    return others[int(rng.integers(len(others)))]


def spoil(thing: Any, rng: np.random.Generator) -> None:
    """Change one place in nested dicts, lists, tuples and arrays, in place: gone, longer, shorter, or another value."""
    holder, key = _place(thing, rng)
    value = holder[key]
    wrong: list[Any] = [None, -1, 10**6, 2**40, "text", [], {}, np.nan, np.zeros((2, 2)), [0, 0, 0], -0.5]
    if isinstance(value, list | tuple):
        wrong += [type(value)(list(value)[:-1]), type(value)([*value, *value])]
    if isinstance(value, int | float) and not isinstance(value, bool):
        wrong += [value + 1, value - 1, -value]
    if isinstance(holder, dict) and rng.random() < 0.1:
        del holder[key]
    else:
        holder[key] = wrong[int(rng.integers(len(wrong)))]


def _place(thing: Any, rng: np.random.Generator) -> tuple[Any, Any]:
    """A random place within: what holds it, made writable, and its key there."""
    keys = list(thing) if isinstance(thing, dict) else list(range(len(thing)))
    key = keys[int(rng.integers(len(keys)))]
    value = thing[key]
    if isinstance(value, list | tuple | dict) and len(value) and rng.random() < 0.85:
        if isinstance(value, tuple):
            inner = list(value)
            holder, place = _place(inner, rng)
            return _Through(thing, key, inner, holder), place
        return _place(value, rng)
    return thing, key


class _Through:
    """A place within a tuple: a change there makes the tuple anew."""

    def __init__(self, outer: Any, key: Any, inner: list[Any], holder: Any) -> None:
        self._outer, self._key, self._inner, self._holder = outer, key, inner, holder

    def __getitem__(self, place: Any) -> Any:
        return self._holder[place]

    def __setitem__(self, place: Any, value: Any) -> None:
        self._holder[place] = value
        self._outer[self._key] = tuple(self._inner)


if __name__ == "__main__":
    main()

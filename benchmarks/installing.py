"""From nothing to the first result, beside MuJoCo and Drake: `python benchmarks/installing.py WHEEL`.

Each package is installed by pip from the index, without a cache, into a virtual environment of its own that sees no
compiler; ccpin from the wheel given. Then a first program is run in a fresh process, twice: the first time Python
compiles what it imports.
"""

import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

CCPIN = """
import ccpin
from ccpin import visualization
model = ccpin.ReducedModel(ccpin.load("rpdr"))
law = ccpin.control.PDSimpleGravity(model, q_d=[-1.57, -1.75], K_p=[11, 11], K_v=[0.65, 0.60])
motion = ccpin.simulate(model, law, q0=[-2.62, -2.79], duration=1.0)
visualization.animate(model.mechanism, motion.t, motion.q_free, "motion.html")
assert ccpin.backend().name == "native"
"""
MUJOCO = """
import mujoco
model = mujoco.MjModel.from_xml_string(
    '<mujoco><worldbody><body><joint type="hinge"/><geom size=".1" pos="1 0 0"/></body></worldbody></mujoco>')
data = mujoco.MjData(model)
while data.time < 1.0:
    mujoco.mj_step(model, data)
"""
DRAKE = """
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
builder = DiagramBuilder()
plant, _ = AddMultibodyPlantSceneGraph(builder, 1e-3)
plant.Finalize()
Simulator(builder.Build()).AdvanceTo(1.0)
"""


class Installed(NamedTuple):
    """What one package costs.

    Attributes:
        install: Seconds of pip.
        size: Bytes of the environment less those of an empty one.
        first, second: Seconds of the first program and of the same again.
    """

    install: float
    size: int
    first: float
    second: float


def main() -> None:
    """Install and run each; print the table."""
    packages = {"ccpin": (sys.argv[1], CCPIN), "mujoco": ("mujoco", MUJOCO), "drake": ("drake", DRAKE)}
    print(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}")
    print("| package | pip install, s | MB | first program, s | again, s |\n|---|---:|---:|---:|---:|")
    for name, (requirement, program) in packages.items():
        with tempfile.TemporaryDirectory() as folder:
            found = installed(Path(folder), requirement, program)
        row = f"{found.install:.0f} | {found.size / 1e6:.0f} | {found.first:.1f} | {found.second:.1f}"
        print(f"| {name} | {row} |", flush=True)


def installed(folder: Path, requirement: str, program: str) -> Installed:
    """Install what is required into an environment below a folder and run the program there."""
    subprocess.run([sys.executable, "-m", "venv", str(folder / "env")], check=True)
    python, environment = folder / "env/bin/python", {**os.environ, "PATH": str(folder / "env/bin")}
    environment.update(MPLCONFIGDIR=str(folder), PYTHONPYCACHEPREFIX="", PYTHONDONTWRITEBYTECODE="")
    assert not any(shutil.which(compiler, path=environment["PATH"]) for compiler in ("cc", "c++", "g++", "cmake"))
    empty = size(folder / "env")
    pip = [python, "-m", "pip", "install", "--quiet", "--no-cache-dir", "--disable-pip-version-check"]
    install = seconds([*pip, "--only-binary", ":all:", requirement], folder, environment)
    first, second = (seconds([python, "-c", program], folder, environment) for _ in range(2))
    return Installed(install, size(folder / "env") - empty, first, second)


def seconds(command: list[str | Path], folder: Path, environment: Mapping[str, str]) -> float:
    """Of a command that must succeed, on the clock."""
    begun = time.perf_counter()
    subprocess.run(command, cwd=folder, env=environment, check=True)
    return time.perf_counter() - begun


def size(folder: Path) -> int:
    """Bytes of all files below a folder, links not followed."""
    return sum(path.lstat().st_size for path in folder.rglob("*") if not path.is_dir())


if __name__ == "__main__":
    main()

"""Imports go one way, `import ccpin` is light, and public names exist."""

import ast
import importlib
import re
import subprocess
import sys
from collections import Counter
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import ccpin
from tests.support.imports import MODULES, ORDER, SOURCE, graph, imported, room

ORDER_WITHIN: dict[str, tuple[str | tuple[str, ...], ...]] = {  # names in one tuple do not import each other
    "control": (
        *("references", "statements", "control_law", "laws", ("sampling", "servos", "tracking"), "stability", "online"),
    ),
    "control.stability": (("set_point", "tracking"),),
    "simulation": ("events", "plant", "results", "integration", "studies"),
    "description": (
        ("model", "names", "rotations"),
        ("closure_kinds", "drafts", "joint_kinds"),
        ("checks", "elements"),
        ("changes", "mjcf", "sdf"),
        ("finding", "urdf"),
        "toolbox",
        "formats",
    ),
    "kinematics": (
        ("least_squares", "linear", "scratch"),
        "tree",
        ("coordinates", "loops", "points"),
        ("clusters", "rows"),
        "constraints",
        "derivative_bounds",
        ("continuation", "dead_ends"),
        "parametrization",
        "sigma_derivatives",
    ),
    "mechanism": (
        ("physics", "pinocchio", "poses"),
        ("motion", "repair"),
        "mechanism",
        ("assumptions", "joint_limits", "loading", "other_coordinates", "wireframe"),
    ),
    "identification": (("calibration", "combinations", "logs"), ("adaptive", "estimates")),
    "validated": ("arithmetic", "loop_equations", "model", "flow", "sets", "programs"),
    "domain": (
        "closures",
        "documents",
        "singular",
        ("paths", "theorem2"),
        ("atlas", "sheets"),
        ("merging", "workspaces"),
    ),
    "domain.closures": (
        "scalar_coordinates",
        ("rods", "task_coordinates"),
        "system",
        ("packing", "seeds"),
        "searchable",
    ),
    "covering": (
        ("region", "sources"),
        ("cells", "documents"),
        ("faces", "merging", "runner"),
        ("pruning", "proposals"),
        "claims",
    ),
    "proof.curves": ("curve_equations", "tubes", ("settled_boxes", "tube_claims"), "singular_covers"),
    "proof": (
        ("theorems", "rounding", "digests", "verdict", "facts"),
        ("balls", "chains", "chords"),
        ("ranges", "bounds", "tips"),
        ("emptiness", "phasors", "taylor"),
        "reach_bounds",
        "equations",
        ("newton", "prolongations"),
        ("narrowing", "requirements", "solutions", "zeros"),
        ("candidates", "cell_tree", "demanded", "paths"),
        ("covers", "exhausted"),
        ("curves", "lines", "solution_counts"),
    ),
}
OF_NO_ROOM = (("scripts",), ("docs",))  # tests of what is no part of the package
OUTERMOST = ("__init__", "cli", "__main__")  # public names, then what calls them
PINOCCHIO = {"kinematics", "mechanism", "dynamics", "visualization"}
HEAVY = ("numpy", "scipy", "pinocchio", "meshcat", "matplotlib", "dask", "distributed", "yourdfpy", "trimesh", "flint")
DRAWING = ("meshcat", "matplotlib", "dask", "distributed", "yourdfpy", "trimesh", "flint")
UNLOADED = (  # of what loading a mechanism and making its model need not wait for
    *DRAWING,
    *(f"scipy.{name}" for name in ("integrate", "interpolate", "optimize", "sparse", "spatial", "special", "stats")),
    *("contourpy", "pandas", "shtab", "tqdm", "yaml"),
)
LOADING = "import ccpin; ccpin.ReducedModel(ccpin.load('rpdr'))"


def test_the_graph_sees_imports():
    """The parser of these tests finds known imports, lazy ones included (else the tests below prove nothing)."""
    assert "ccpin.kinematics.tree" in graph()["ccpin.mechanism.mechanism"]
    assert "ccpin.description.urdf.reader" in graph()["ccpin.description.formats"]
    assert "pinocchio" in imported("ccpin.kinematics.tree")


def test_no_cycles():
    """The module import graph is acyclic."""
    TopologicalSorter(graph()).prepare()


def test_every_module_has_its_room():
    """Every module belongs to a room of the design."""
    assert {room(module) for module in MODULES} - set(ORDER) - set(OUTERMOST) == set()


def test_no_test_imports_another():
    """Tests share `tests/support`, `tests/oracles` and `tests/mutants`; their folders are the package's rooms."""
    tests = Path(__file__).parent
    for path in tests.rglob("test_*.py"):
        shared = re.findall(r"^\s*(?:from|import) tests\.?(\w*)", path.read_text(encoding="utf-8"), re.MULTILINE)
        assert set(shared) <= {"support", "oracles", "mutants"}, path
    folders = {path.parent.relative_to(tests).parts for path in tests.rglob("test_*.py")}
    assert [folder for folder in folders if folder not in OF_NO_ROOM and not SOURCE.joinpath(*folder).is_dir()] == []


def test_imports_go_down_the_list():
    """A module imports only rooms before its own (or its own)."""
    rank = {name: k for k, name in enumerate((*ORDER, *OUTERMOST))}
    pairs = [(module, name) for module, names in graph().items() for name in sorted(names)]
    assert [(one, other) for one, other in pairs if rank.get(room(other), 99) > rank.get(room(one), -1)] == []


@pytest.mark.parametrize("package", sorted(ORDER_WITHIN))
def test_imports_go_one_way_inside_a_package(package):
    """Its folders and modules import only what stands before them in its order, which names them all."""
    floors = [(floor,) if isinstance(floor, str) else floor for floor in ORDER_WITHIN[package]]
    rank = {name: k for k, floor in enumerate(floors) for name in floor}
    inside = f"ccpin.{package}."
    place = {module: module.removeprefix(inside).split(".")[0] for module in MODULES if module.startswith(inside)}
    assert set(place.values()) == set(rank)
    for module, own in place.items():
        others = {name: place[name] for name in graph()[module] if place.get(name, own) != own}
        upward = [name for name, other in others.items() if rank[other] >= rank[own]]
        assert not upward, f"{module} imports {upward}"


def test_the_kernel_asks_nobody():
    """Proofs are checked by `proof` alone: neither the compiled core nor any other room has a say.

    `work` tells when a check is to end, which is to prove nothing.
    """
    used = {room(name) for module in MODULES if room(module) == "proof" for name in graph()[module]}
    assert used <= {"proof", "arrays", "errors", "work"}


def test_who_knows_pinocchio():
    """Only the rooms of the free system's geometry and dynamics import Pinocchio."""
    users = {room(module) for module in MODULES if any(n.split(".")[0] == "pinocchio" for n in imported(module))}
    assert users <= PINOCCHIO


@pytest.mark.parametrize(
    ("code", "absent"),
    [("import ccpin", HEAVY), ("import ccpin; ccpin.simulate", DRAWING), (LOADING, UNLOADED)],
    ids=["package", "simulate", "load"],
)
def test_import_is_light(code, absent):
    """`import ccpin` loads nothing; its names and a model neither drawing nor clusters nor most of SciPy."""
    code = f"import sys; {code}; print(sorted(set({absent!r}) & set(sys.modules)))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_what_scripts_use_is_public():
    """Scripts and benchmarks import from the package and the public faces of its rooms only."""
    root = Path(__file__).resolve().parents[1]
    for path in (*root.glob("scripts/*.py"), *root.glob("benchmarks/**/*.py"), root / "README.md"):
        inner = re.findall(r"^\s*(?:from|import) ccpin\.\w+\.\w.*", path.read_text(encoding="utf-8"), re.MULTILINE)
        assert inner == [], path
    with pytest.raises(AttributeError, match="no attribute 'Joint'"):
        _ = ccpin.Joint


FACES = (
    "ccpin.errors",
    *(module for module, path in MODULES.items() if path.name == "__init__.py"),
)
MOST_PUBLIC = 197


def test_public_names_exist():
    """Every name in every ``__all__`` exists, once and in one of them alone; `dir` of a face shows nothing else."""
    told = Counter()
    for name in FACES:
        face = importlib.import_module(name)
        if not hasattr(face, "__all__"):
            continue
        assert dir(face) == sorted(face.__all__), name
        assert [public for public in face.__all__ if not hasattr(face, public)] == [], name
        told.update(face.__all__)
    assert {name for name, number in told.items() if number > 1} <= {"write"}  # of the report, and of the paper's page
    assert 100 < sum(told.values()) <= MOST_PUBLIC


def test_nothing_prints_but_the_command_line():
    """No module outside `cli` calls print."""
    for module, path in MODULES.items():
        text = path.read_text(encoding="utf-8")
        if room(module) in ("cli", "__main__") or "print" not in text:
            continue
        for node in ast.walk(ast.parse(text)):
            assert not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print"), (
                f"{path.name}:{node.lineno}"
            )


# One word, one thing: what still stands for two. These lists may only become shorter.
CLASSES_OF_ONE_NAME = {"Effort", "Reading"}
MODULES_OF_ONE_ROLE = {
    "certifying",
    "cover",
    "documents",
    "joints",
    "merged",
    "merging",
    "meshes",
    "reader",
    "words",
    "writer",
}
MODULES_OF_ONE_NAME = {"balls", "workspace", "sheets"}
MODULES_NAMED_AS_A_FUNCTION = {"certifier", "drawn_bodies", "specification"}


def test_one_word_is_one_thing():
    """No two classes share a name, nor two modules but for sisters of one role, nor a module and its function."""
    classes, modules, functions = Counter(), Counter(), set()
    for module, path in MODULES.items():
        text, own = path.read_text(encoding="utf-8"), module.rpartition(".")[2]
        classes.update(re.findall(r"^ *class _*(\w+)[(:]", text, re.MULTILINE))
        if path.name == "__init__.py" or room(module) == "cli":  # commands are named as what they call
            continue
        modules[own] += 1
        functions |= {own} if re.search(rf"^def {own}\(", text, re.MULTILINE) else set()
    assert {name for name, number in classes.items() if number > 1} <= CLASSES_OF_ONE_NAME
    assert {name for name, number in modules.items() if number > 1} <= MODULES_OF_ONE_ROLE | MODULES_OF_ONE_NAME
    assert functions <= MODULES_NAMED_AS_A_FUNCTION

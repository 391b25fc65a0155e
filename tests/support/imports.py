"""Who imports whom in the package: every module, every import statement that runs."""

import ast
from functools import cache
from pathlib import Path

import ccpin

SOURCE = Path(ccpin.__file__).parent
ORDER = (
    "errors",
    "arrays",
    "files",
    "containers",
    "schemas",
    "displays",
    "work",
    "auditing",
    "proof",
    "description",
    "kinematics",
    "mechanism",
    "native",
    "covering",
    "dynamics",
    "domain",
    "control",
    "programs",
    "simulation",
    "validated",
    "visualization",
    "plotting",
    "pages",
    "identification",
    "transmission",
    "paper",
    "report",
    "studio",
    "gym",
)


def module_name(path):
    parts = ("ccpin", *path.relative_to(SOURCE).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path): path for path in sorted(SOURCE.rglob("*.py"))}


def room(module):
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else "__init__"


def _statements(node):
    """Every import statement that runs, also those inside functions; not those for type checkers only."""
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, ast.stmt | ast.excepthandler | ast.match_case):
            continue
        if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.dump(child.test):
            continue
        if isinstance(child, ast.Import | ast.ImportFrom):
            yield child
        yield from _statements(child)


@cache
def imported(module):
    """Absolute names of the modules a module imports (a name imported from a package counts if it is a module)."""
    package = module if MODULES[module].name == "__init__.py" else module.rpartition(".")[0]
    names = set()
    for statement in _statements(ast.parse(MODULES[module].read_text(encoding="utf-8"))):
        if isinstance(statement, ast.Import):
            names |= {alias.name for alias in statement.names}
            continue
        base = statement.module or ""
        if statement.level:
            parent = package.split(".")[: len(package.split(".")) - statement.level + 1]
            base = ".".join([*parent, *([base] if base else [])])
        for alias in statement.names:
            names.add(f"{base}.{alias.name}" if f"{base}.{alias.name}" in MODULES else base)
    return frozenset(names)


@cache
def graph():
    """Which modules of the package each module imports."""
    return {module: {name for name in imported(module) if name in MODULES} for module in MODULES}

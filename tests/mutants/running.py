"""Mutants tried in processes forked from a test session that has collected its tests: each costs what its tests do."""

from __future__ import annotations

import ast
import gc
import importlib
import os
import resource
import signal
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout, suppress
from io import StringIO
from pathlib import Path
from types import CodeType, FunctionType
from typing import Literal

import pytest

from tests.mutants.changes import Change

Outcome = Literal["killed", "survives", "too long"]
SECONDS = 30  # of processor time: the same on a busy machine
_WAITING = 5 * SECONDS  # by the clock, for one that sleeps
_NOT_APPLIED = 3
ROOT = Path(__file__).parents[2]
SOURCES = ROOT / "src" / "ccpin"


def source_of(module: str) -> Path:
    """The file of a module named from ccpin on, as ``proof/newton``."""
    return SOURCES / f"{module}.py"


def outcomes_of(module: str, changes: Sequence[Change | None], tests: tuple[str, ...], processes: int) -> list[Outcome]:
    """What tests say of a module's mutants (``None``: of the module as it is)."""
    importlib.import_module(_name(module))
    named = tuple(test for test in tests if "::" in test)
    session = _Forks([lambda change=change: change and _apply(module, change) for change in changes], processes, named)
    with redirect_stdout(StringIO()) as said:
        options = ["-q", "-p", "no:cacheprovider", "--tb=no", "-m", ""]
        pytest.main([*options, *(str(ROOT / "tests" / test) for test in tests)], plugins=[session])
    if not session.outcomes:
        raise RuntimeError(f"the tests of {module} were not collected:\n{said.getvalue()}")
    return session.outcomes


class _Forks:
    """A plugin of pytest that runs the collected tests once in a fork for every change, instead of here.

    Of slow tests those that are named one by one run, of a file the others alone.
    """

    def __init__(self, changes: Sequence[Callable[[], object]], processes: int, named: tuple[str, ...]) -> None:
        self._changes, self._processes, self._named = changes, processes, named
        self.outcomes: list[Outcome] = []

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Leave out slow tests that nobody named."""
        named = tuple(f"tests/{test}" for test in self._named)
        items[:] = [item for item in items if not item.get_closest_marker("slow") or item.nodeid.startswith(named)]

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Run them all."""
        self.outcomes = ["too long"] * len(self._changes)
        gc.unfreeze()  # `_apply` asks the collector for all functions (tests/conftest.py)
        gc.collect()
        running: dict[int, tuple[int, float]] = {}
        waiting = list(enumerate(self._changes))[::-1]
        while waiting or running:
            while waiting and len(running) < self._processes:
                number, change = waiting.pop()
                running[_fork(session, change)] = number, time.monotonic() + _WAITING
            for child, (number, deadline) in list(running.items()):
                ended, status = os.waitpid(child, os.WNOHANG)
                if ended and os.waitstatus_to_exitcode(status) == _NOT_APPLIED:
                    raise RuntimeError(f"change {number} could not be made")
                if ended:
                    self.outcomes[number] = _outcome(status)
                    del running[child]
                elif time.monotonic() > deadline:
                    os.kill(child, signal.SIGKILL)
                    os.waitpid(child, 0)
                    del running[child]
            time.sleep(0.005)
        return True


def _outcome(status: int) -> Outcome:
    """What a process's end says: `_fork`'s 0 or 1, or that its processor time was spent."""
    if os.WIFSIGNALED(status) and os.WTERMSIG(status) in (signal.SIGXCPU, signal.SIGKILL):
        return "too long"
    return "killed" if status else "survives"


def _fork(session: pytest.Session, change: Callable[[], object]) -> int:
    """A process that runs a session's tests with a change, and ends with 0 where they pass, 1 where they do not."""
    child = os.fork()
    if child:
        return child
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 1))
    signal.signal(signal.SIGXCPU, signal.SIG_DFL)
    end = _NOT_APPLIED
    with suppress(BaseException), Path(os.devnull).open("w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
        change()
        end = 1
        for number, item in enumerate(session.items):
            following = session.items[number + 1] if number + 1 < len(session.items) else None
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
            if session.testsfailed:
                break
        end = int(session.testsfailed > 0)
    os._exit(end)


def _name(module: str) -> str:
    return "ccpin." + module.replace("/", ".")


def _apply(module: str, change: Change) -> None:
    """Give the module's functions the changed code, and every module that imported its constants the changed ones."""
    original, path = importlib.import_module(_name(module)), str(source_of(module))
    tree = change.tree(source_of(module).read_text())
    codes = {(c.co_qualname, c.co_firstlineno): c for c in _codes(compile(tree, path, "exec"))}
    for function in [f for f in gc.get_objects() if isinstance(f, FunctionType)]:
        code = function.__code__
        new = codes.get((code.co_qualname, code.co_firstlineno))
        if code.co_filename == path and new is not None:
            function.__code__ = new
    for statement in tree.body:
        if isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name | ast.Tuple):
            fresh = dict(vars(original))
            exec(compile(ast.Module([statement], []), path, "exec"), fresh)
            names = [n.id for n in ast.walk(statement.targets[0]) if isinstance(n, ast.Name)]
            for name in names:
                if change.place in names or isinstance(fresh[name], float | tuple):
                    _rebind(name, vars(original)[name], fresh[name])


def _rebind(name: str, old: object, new: object) -> None:
    """Bind a changed constant wherever the old one is bound by import."""
    for module in [m for k, m in sys.modules.items() if k.startswith("ccpin")]:
        if vars(module).get(name) is old:
            setattr(module, name, new)


def _codes(code: CodeType) -> list[CodeType]:
    inner = [c for c in code.co_consts if isinstance(c, CodeType)]
    return [code, *(found for c in inner for found in _codes(c))]

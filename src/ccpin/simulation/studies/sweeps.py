"""Parameter studies: one task over many cases, on any number of processes, that can be killed and taken up again."""

from __future__ import annotations

import csv
import json
import pickle
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import ExitStack
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ccpin.arrays import instance, listener, whole
from ccpin.errors import InvalidInputError
from ccpin.files import Journal, write_atomically
from ccpin.simulation.results import saving
from ccpin.simulation.studies.cases import Case
from ccpin.simulation.studies.origins import origin_of
from ccpin.work import executor_for, stoppable

if TYPE_CHECKING:
    import pandas as pd

Task = Callable[[Case], Any]

_POLL = 0.2  # s between looks at whether the work is to end
_IN_FLIGHT = 1000  # cases handed to a pool whose number of workers is not known


class SweepProgress(NamedTuple):
    """How many cases are done, how many of these failed, and how many there are."""

    done: int
    failed: int
    total: int


class Sweep(NamedTuple):
    """The rows of a sweep, in the order of the cases.

    Attributes:
        cases: What was asked for, each by name.
        results: What the task returned, by name; ``None`` where it failed or was not run.
        errors: The error of each case that failed, ``""`` for the others.
        complete: Whether every case was run; False after Ctrl-C.
    """

    cases: tuple[Case, ...]
    results: tuple[dict[str, Any] | None, ...]
    errors: tuple[str, ...]
    complete: bool

    def __repr__(self) -> str:
        failed = sum(map(bool, self.errors))
        return f"Sweep({len(self.cases)} cases, {failed} failed{'' if self.complete else ', not complete'})"

    def table(self) -> dict[str, list[Any]]:
        """One column a name: the cases', the results' (lists as ``name_0``, ``name_1``, …) and ``error``.

        What a row has not is ``None``; a result of the name of a case's value stands as ``result_name``.
        """
        own = list(dict.fromkeys(name for case in self.cases for name in case))
        taken = {*own, "error"}
        found = [_flat(result or {}) for result in self.results]
        names = list(dict.fromkeys(name for result in found for name in result))
        columns: dict[str, list[Any]] = {name: [case.get(name) for case in self.cases] for name in own}
        for name in names:
            columns[f"result_{name}" if name in taken else name] = [result.get(name) for result in found]
        return columns | {"error": list(self.errors)}

    def to_pandas(self) -> pd.DataFrame:
        """The table as a data frame.

        Raises:
            InvalidInputError: pandas is not installed.
        """
        return saving.data_frame(self.table())

    def save(self, path: str | Path) -> None:
        """Write the table as CSV with a header line, or as Parquet, by the path's ending; whole or not at all.

        Raises:
            InvalidInputError: Another ending, the file cannot be written, or Parquet without the extra ``tables``.
        """
        if Path(path).suffix == ".parquet":
            saving.write_parquet(self.to_pandas(), Path(path))
            return
        if Path(path).suffix != ".csv":
            raise InvalidInputError(f"'{path}' must end in .csv or .parquet")
        table = self.table()

        def write(file: Any) -> None:
            rows = csv.writer(file, lineterminator="\n")
            rows.writerow(table)
            rows.writerows(zip(*table.values(), strict=True))

        write_atomically(path, "w", write)


def sweep(
    task: Task,
    cases: Iterable[Mapping[str, Any]],
    *,
    seed: int | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    path: str | Path | None = None,
    name: str = "",
    progress: Callable[[SweepProgress], None] | None = None,
) -> Sweep:
    """Run a task for every case; a case that fails is a row with its error, never a lost sweep.

    Args:
        task: A function of a case that returns numbers, words or lists of them by name (a mapping, a named tuple, or
            what has `as_json`, like `Metrics`). For other processes it must be found by its name in a module
            (`functools.partial` hands it a model).
        cases: The cases: names and numbers, words or lists of these (`grid`, `latin_hypercube` and `sobol` make them).
        seed: Gives each case that has none a ``seed`` of its own, from this number and the case's place alone.
        workers: How many processes to start; default none: all is done in this one. A script that asks for more than
            one needs the guard ``if __name__ == "__main__":``.
        executor: In place of `workers` anything with ``submit``: a process pool, Dask's ``client.get_executor()``.
            The table depends on neither, as long as the task depends on its case alone.
        path: A file to which each row is appended when it is done; the same call finds the rows again after a crash
            or ``kill -9`` and goes on with the others. Rows that failed are rows: they are not tried again. A file of
            another task, of other numbers or of another version of ccpin is refused.
        name: What the task is called in the file: needed where it is a function, of which nothing else tells whether it
            is the same one.
        progress: Called after every row, and once before the first.

    Returns:
        Sweep: Every row; after Ctrl-C those done, with ``complete`` False.

    Raises:
        InvalidInputError: Cases that are no such mappings, a task that cannot be sent to other processes, a file of
            another sweep, a file for a function without a name, bad `workers`.
    """
    seed = None if seed is None else whole(seed, "seed", 0)
    rows = [_case(number, case, seed) for number, case in enumerate(instance(cases, "cases", Iterable, "mappings"))]
    keys = [json.dumps(row, sort_keys=True) for row in rows]
    _check_task(task, workers, executor)
    report = listener(progress)
    with ExitStack() as stack:
        journal, done = None, dict[str, dict[str, Any]]()
        if path is not None:
            header = {"format": "ccpin-sweep-2", **origin_of(task, name, "the task of the sweep")}
            journal = stack.enter_context(Journal(path, header))
            done = {record["case"]: record for record in journal}
        report(_progress(keys, done))
        flag = stack.enter_context(stoppable())
        missing = [number for number, key in enumerate(keys) if key not in done]
        try:
            for number, outcome in _outcomes(task, rows, missing, executor, workers, flag):
                done[keys[number]] = outcome
                if journal is not None:
                    journal.append({"case": keys[number], **outcome})
                report(_progress(keys, done))
        except KeyboardInterrupt:
            flag.set()
    found = [done.get(key, {}) for key in keys]
    results = tuple(row.get("result") for row in found)
    errors = tuple(str(row.get("error", "")) for row in found)
    return Sweep(tuple(rows), results, errors, all(key in done for key in keys))


def _case(number: int, case: Mapping[str, Any], seed: int | None) -> Case:
    if not isinstance(case, Mapping) or not all(isinstance(name, str) for name in case):
        raise InvalidInputError(f'case {number} is {case!r}; it must be values by name, like {{"mass": 1.1}}')
    try:
        plain: Case = {name: _plain(value) for name, value in case.items()}
    except TypeError as error:
        raise InvalidInputError(f"case {number}: {error}") from None
    if seed is not None and "seed" not in plain:
        plain["seed"] = int(np.random.SeedSequence([seed, number]).generate_state(1)[0])
    return plain


def _plain(value: Any) -> Any:
    """Numbers, words and lists of them as JSON has them.

    Raises:
        TypeError: It is none of these.
    """
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic | np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list | tuple) and not hasattr(value, "_asdict"):
        return [_plain(each) for each in value]
    raise TypeError(f"{value!r} is no number, word or list of them")


def _flat(result: Mapping[str, Any]) -> dict[str, Any]:
    """Lists as one entry each."""
    flat: dict[str, Any] = {}
    for name, value in result.items():
        if isinstance(value, list):
            flat |= _flat({f"{name}_{k}": each for k, each in enumerate(value)})
        else:
            flat[name] = value
    return flat


def _check_task(task: Task, workers: int | None, executor: Executor | None) -> None:
    if not callable(task):
        raise InvalidInputError(f"the task of a sweep must be a function of a case, not {type(task).__name__}")
    if workers in (None, 1) and executor is None:
        return
    try:
        pickle.dumps(task)
    except Exception as error:
        raise InvalidInputError(f"the task cannot be sent to other processes; define it in a module: {error}") from None


def _progress(keys: list[str], done: Mapping[str, Mapping[str, Any]]) -> SweepProgress:
    rows = [done[key] for key in keys if key in done]
    return SweepProgress(len(rows), sum("error" in row for row in rows), len(keys))


# Running the cases; an outcome is {"result": …} or {"error": …}.


def _run(task: Task, case: Case) -> dict[str, Any]:
    try:
        found = task(dict(case))
        found = found.as_json() if hasattr(found, "as_json") else getattr(found, "_asdict", lambda: found)()
        if not isinstance(found, Mapping):
            raise TypeError(f"the task returned {type(found).__name__}; it must return values by name")
        return {"result": {str(name): _plain(value) for name, value in found.items()}}
    except Exception as error:
        return {"error": f"{type(error).__name__}: {error}"}


def _outcomes(
    task: Task, rows: list[Case], missing: list[int], executor: Executor | None, workers: int | None, flag: Event
) -> Iterator[tuple[int, dict[str, Any]]]:
    """The rows missing as they are done; each life of a pool ends with the work, an interrupt or a worker's death."""
    waiting = deque(missing)
    while waiting and not flag.is_set():
        with executor_for(executor, workers) as pool:
            if pool is None:
                number = waiting.popleft()
                yield number, _run(task, rows[number])
                continue
            lost: list[int] = []
            most = _IN_FLIGHT if workers is None else 2 * workers
            yield from _pooled(task, rows, waiting, pool, most, lost, flag)
        for number in lost:
            if not flag.is_set():
                yield number, _alone(task, rows[number])


def _pooled(
    task: Task, rows: list[Case], waiting: deque[int], pool: Executor, most: int, lost: list[int], flag: Event
) -> Iterator[tuple[int, dict[str, Any]]]:
    """One life of a pool: rows that were at work when a worker died are `lost`, those after them still `waiting`."""
    futures: dict[Future[dict[str, Any]], int] = {}
    while not flag.is_set() and (futures or (waiting and not lost)):
        while waiting and len(futures) < most and not lost:
            number = waiting.popleft()
            try:
                futures[pool.submit(_run, task, rows[number])] = number
            except RuntimeError:
                lost.append(number)
        for future in wait(futures, _POLL, FIRST_COMPLETED).done:
            number = futures.pop(future)
            if future.cancelled() or future.exception() is not None:
                lost.append(number)
            else:
                yield number, future.result()


def _alone(task: Task, case: Case) -> dict[str, Any]:
    """A case in a process of its own: perhaps it was another that killed the worker."""
    with executor_for(None, 2) as pool:
        assert pool is not None
        try:
            return pool.submit(_run, task, case).result()
        except Exception as error:
            return {"error": f"its process died: {error}"}

"""What the results in a file are of, so that nobody goes on with another's: a task, its numbers, and the code."""

from __future__ import annotations

from functools import partial
from typing import Any

from ccpin.arrays import instance
from ccpin.covering.sources import code_digest
from ccpin.errors import InvalidInputError
from ccpin.proof.digests import digest_or_none

_ROOMS = ("control", "dynamics", "simulation")


def origin_of(task: object, name: str, argument: str) -> dict[str, str]:
    """The name of a task, the digest of its numbers, and that of the code of ccpin that works for it.

    An object is told by its class and the numbers it holds, what `functools.partial` hands to a function by its own.
    Of a function nothing tells what it does: it goes by the name that its caller gives it, who gives another one where
    it does something else.

    Args:
        task: It.
        name: What the caller calls it; may be empty where it is no function.
        argument: How errors call the task.

    Raises:
        InvalidInputError: A function has no name.
    """
    instance(name, "name", str, "a word")
    own = digest_or_none(task)
    if not own and not name:
        raise InvalidInputError(
            f"{argument} is a function or holds one, and no number tells what that does: to find its results again in "
            "a file, give name=, a word of yours for it, and another one where it does something else"
        )
    if isinstance(task, partial):
        own = digest_or_none((task.args, dict(task.keywords)))
    return {"task": name or type(task).__qualname__, "digest": own, "code": code_digest(*_ROOMS).hex()}


def numbers_of(options: dict[str, Any]) -> dict[str, Any]:
    """Options as a file's head has them: numbers and words as they are, else digests; of functions empty ones."""
    plain = bool | int | float | str | None
    return {name: value if isinstance(value, plain) else digest_or_none(value) for name, value in options.items()}

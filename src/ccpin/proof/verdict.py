"""The three verdicts of a check: what is known, and what only was not found out.

Every certificate of ccpin answers with `verdict`, and with `reason`, a sentence that says what was found, what it cost
and, where nothing was decided, which argument to raise. A refutation comes with a `witness` that anyone can check.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any, Literal, NamedTuple

from ccpin.arrays import Array

Verdict = Literal["proven", "refuted", "undecided"]
"""``"proven"``: a theorem's hypotheses were checked. ``"refuted"``: they fail, and the result holds a witness.
``"undecided"``: neither was shown with the work allowed; the result says what was spent and what more would do."""


Kind = Literal["singular", "empty", "limit", "dexterity", "state"]


def of_file(source: str | None) -> str:
    """What is said besides of a certificate that was loaded: boxes and tubes were proved again, no more than that."""
    if source is None:
        return ""
    return f"; as {source} says: boxes and tubes were proved again, the rest by `ccpin verify` alone"


def not_known_of(subject: str) -> str:
    """What is said of facts that are missing, or are about something else."""
    return f"what was found is not proved of {subject}, or was pickled and not replayed"


def fields_of(record: Any) -> dict[str, Any]:
    """A dataclass's fields by name, without what it keeps beside them."""
    return {each.name: getattr(record, each.name) for each in fields(record)}


class Judged:
    """What has a `verdict` and a `reason`, and shows itself by them."""

    def __repr__(self: Any) -> str:
        return f"{type(self).__name__}({self.verdict}: {self.reason})"

    def __getstate__(self: Any) -> dict[str, Any]:
        """The fields alone: what was known by facts is not known of what they are once they were pickled."""
        return fields_of(self)


class Witness(NamedTuple):
    """Where a claim about σ fails.

    Attributes:
        kind: ``"singular"``: a closed configuration with singular ψ_q′ is on the branch; ``"empty"``: no closed
            configuration has this q; ``"limit"``, ``"dexterity"``: on the branch a joint is beyond its limits there,
            or the end effector's Jacobian is conditioned worse than was asked for; ``"state"``: a motion is in a state
            from which the claim cannot hold.
        q: The independent coordinates, of shape (n,), in the scalar coordinates of certificates.
        q_free: The configuration, of shape (nq,); ``None`` where there is none.
        error: The exact one is this near in every coordinate (rad, m); 0 where it is exact.
    """

    kind: Kind
    q: Array
    q_free: Array | None
    error: float

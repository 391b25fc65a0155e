"""The three verdicts of a check: what is known, and what only was not found out."""

from __future__ import annotations

from typing import Literal

Verdict = Literal["proven", "refuted", "undecided"]
"""``"proven"``: a theorem's hypotheses were checked. ``"refuted"``: they fail, and the result holds a witness.
``"undecided"``: neither was shown with the work allowed; the result says what was spent and what more would do."""

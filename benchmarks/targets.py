"""What the compiled core is to reach, beside what was measured: met or missed."""

from __future__ import annotations

from collections.abc import Sequence


def checked(figures: Sequence) -> str:
    return ""

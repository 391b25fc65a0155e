"""Cycles of the plugin of ros2_control: `python -m benchmarks.ros2_plugin [NAME …]`.

For the knee, the neck and the ankle: microseconds of a cycle (`actuator_to_joint` and `joint_to_actuator`, handles
read and written, g++ -O2) over 10⁵ commands, a closed curve of 1000 again and again, the best and the median round;
and how far the answers are from Python's at most, in parts of their size, or of 1.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from ccpin.transmission import export_ros2
from tests.support.driven_plugins import built, in_python, walk
from tests.support.linkage_models import FORMS, transmission_of

ROUNDS, COMMANDS, SIZE = 100, 1_000, 0.6  # SIZE: of the range


def main(names: list[str]) -> None:
    """A line a transmission."""
    for name in names or FORMS:
        made = transmission_of(name)
        with tempfile.TemporaryDirectory() as folder:
            export_ros2(made, folder, maintainer="benchmark <benchmark@localhost>", name=name)
            run = built(made, Path(folder), name)
            rows, expected = in_python(made, walk(name, COMMANDS, SIZE))
            out, status, _ = run(rows)
            seconds = [run(rows)[2] for _ in range(ROUNDS)]
        assert not status.any()
        off = (np.abs(out - expected) / np.maximum(1.0, np.abs(expected))).max()
        best, median = 1e6 * min(seconds), 1e6 * float(np.median(seconds))
        print(
            f"{name:6} {made.n} motors: {best:.2f} µs a cycle (median {median:.2f}), {off:.1e} from Python", flush=True
        )


if __name__ == "__main__":
    main(sys.argv[1:])

"""What certificates cost: time against the number of boxes (n = 1, 2, 3), against n for one ball and one path.

Every line is one process. The slope is that of log(time) over log(boxes) by least squares: 1 is proportional. Set
OPENBLAS_NUM_THREADS=1: on matrices this small threads cost more than they save.
"""

import argparse
import json
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import ccpin
from ccpin.domain import certify, certify_path, kantorovich_radius


class Map(NamedTuple):
    """A mechanism, its seed (rad), a region (lower, upper) in rad or ``None``, and the depths to go to."""

    name: str
    seed: tuple[float, ...]
    region: tuple[tuple[float, ...], tuple[float, ...]] | None
    depths: tuple[int, ...]


MAPS = (
    Map("four_bar", (0.7,), None, (8, 14)),
    Map("rpdr", (-1.885, -1.257), None, (7, 8, 9, 10, 11, 12)),
    Map("planar_3rrr", (-0.675, 1.419, -2.769), ((-1.175, 0.919, -3.269), (-0.175, 1.919, -2.269)), (3, 4, 5)),
    Map("delta", (0.0, 0.0, 0.0), ((-0.4,) * 3, (0.7,) * 3), (4,)),
)
SQUARES = ((-108.0, -72.0), (-108.0, -48.0), (-108.0, -120.0), (-70.0, -110.0))
BALLS = ("four_bar", "rpdr", "planar_3rrr", "delta", "stewart", "hexa")


def timed(function: Callable[[], Any]) -> tuple[Any, float]:
    """A result and the seconds it took."""
    start = time.perf_counter()
    result = function()
    return result, time.perf_counter() - start


def map_costs(case: Map) -> dict[str, Any]:
    """Boxes, seconds and certified share at each depth, and the slope."""
    mechanism, rows = ccpin.load(case.name), []
    for depth in case.depths:
        atlas, seconds = timed(lambda d=depth: certify(mechanism, case.seed, case.region, max_depth=d))
        rows.append([depth, len(atlas.boxes.kappa), seconds, atlas.certified_fraction])
    boxes, seconds = np.array(rows)[:, 1:3].T
    slope = float(np.polyfit(np.log(boxes), np.log(seconds), 1)[0]) if np.ptp(boxes) > 0 and len(boxes) > 1 else None
    return {"mechanism": case.name, "n": mechanism.n, "rows": rows, "slope": slope}


def square_costs() -> list[list[float]]:
    """The largest certified squares of the RPDR at four centres: degrees, boxes, seconds."""
    mechanism, rows = ccpin.load("rpdr"), []
    for centre in SQUARES:
        atlas, seconds = timed(lambda c=centre: certify(mechanism, np.radians(c), max_depth=0))
        rows.append([*centre, float(np.degrees(atlas.radius)), len(atlas.boxes.kappa), seconds])
    return rows


def ball_costs() -> list[list[Any]]:
    """One-shot balls: mechanism, n, dependent coordinates, radius, seconds."""
    rows = []
    for name in BALLS:
        mechanism = ccpin.load(name)
        radius, seconds = timed(lambda m=mechanism: kantorovich_radius(m, m.q_reference))
        rows.append([name, mechanism.n, mechanism.n_free - mechanism.n, radius, seconds])
    return rows


def path_costs() -> list[list[Any]]:
    """A straight move of 30 balls from the reference: mechanism, n, boxes, seconds, certified share."""
    rows = []
    for name in BALLS:
        mechanism = ccpin.load(name)
        start = mechanism.parametrization().coordinates.alpha(mechanism.q_reference)
        length = 30.0 * kantorovich_radius(mechanism, mechanism.q_reference)
        ends = np.array([start, start + length / np.sqrt(mechanism.n)])
        path, seconds = timed(lambda m=mechanism, e=ends: certify_path(m, e, 1e-4))
        rows.append([name, mechanism.n, len(path.boxes.kappa), seconds, path.reached])
    return rows


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="the two smallest depths of each map only")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args()
    cases = [case._replace(depths=case.depths[:2]) if arguments.quick else case for case in MAPS]
    found = {
        "maps": [map_costs(case) for case in cases],
        "squares": square_costs(),
        "balls": ball_costs(),
        "paths": path_costs(),
    }
    if arguments.json:
        print(json.dumps(found))
        return
    for case in found["maps"]:
        slope = "" if case["slope"] is None else f", time ~ boxes^{case['slope']:.2f}"
        print(f"{case['mechanism']} (n = {case['n']}){slope}\n  depth   boxes  seconds  ms/box  certified")
        for depth, boxes, seconds, share in case["rows"]:
            print(f"  {depth:5d} {boxes:7d} {seconds:8.2f} {1e3 * seconds / boxes:7.2f} {100 * share:9.4f} %")
    print("largest certified square of the RPDR\n    q1    q2   degrees  boxes  seconds")
    for q1, q2, degrees, boxes, seconds in found["squares"]:
        print(f"  {q1:5.0f} {q2:5.0f} {degrees:9.4f} {boxes:6d} {seconds:8.2f}")
    print("one-shot ball, reach bounds\n  mechanism      n  n′−n    radius  seconds")
    for name, n, m, radius, seconds in found["balls"]:
        print(f"  {name:12s} {n:3d} {m:5d} {radius:9.5f} {seconds:8.2f}")
    print("straight path of 30 balls, tube 1e-4\n  mechanism      n  boxes  seconds  certified")
    for name, n, boxes, seconds, share in found["paths"]:
        print(f"  {name:12s} {n:3d} {boxes:6d} {seconds:8.2f} {100 * share:8.2f} %")


if __name__ == "__main__":
    main()

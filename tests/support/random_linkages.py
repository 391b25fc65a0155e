"""Random planar linkages with gears and slides, each with how many configurations it has: families of `FAMILIES`.

Lengths are in tenths of metres to metres, ratios of gears from 0.5 to 50 either way, regions up to some turns or metres
from the origin; limits and springs are there or not.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from tests.oracles import linkage_counts as oracle
from tests.support.carriages import Y, geared, joint, linkage, pin

NEAR = 1e-7  # of a margin: closer to a fold or a limit the oracle's own rounding may tell the count


class Case(NamedTuple):
    """A mechanism, a region, and its oracle: q (K, n) → counts (K,), −1 where it does not tell."""

    mechanism: object
    region: tuple
    counts: Callable
    searched: bool = False  # whether the oracle is a search of intervals, point by point


def lengths(rng, count):
    """Lengths of links."""
    return rng.uniform(0.1, 0.6, count)


def ratio(rng):
    """A gear's."""
    return float(rng.choice([-1.0, 1.0]) * np.exp(rng.uniform(np.log(0.5), np.log(50.0))))


def spring(rng):
    """A spring on a joint, half of the time."""
    return {"stiffness": float(rng.uniform(0.1, 9.0))} if rng.random() < 0.5 else {}


def limits(rng, low, high, share=0.5):
    """Limits about an interval: on either side, within it or beyond, on both, or none."""
    width, ends = high - low, {}
    for name, end, side in (("lower", low, -1.0), ("upper", high, 1.0)):
        if rng.random() < share:
            ends[name] = float(end + side * width * rng.uniform(-0.4, 0.6))
    return ends


def range_of(middle, reach):
    """Limits about a middle."""
    return {"lower": float(middle - reach), "upper": float(middle + reach)}


def closure(rng):
    """Kinds that say the same of a planar loop."""
    return str(rng.choice(["revolute", "spherical", "cylindrical"]))


def interval(rng, low, high, widest):
    """An interval between two numbers."""
    width = rng.uniform(0.2, 1.0) * widest
    start = rng.uniform(low, high - width)
    return float(start), float(start + width)


def box(*intervals):
    """(lower, upper)."""
    return tuple(np.array(ends) for ends in zip(*intervals, strict=True))


def bounds(chosen):
    """Limits chosen, ±∞ where there is none."""
    return chosen.get("lower", -np.inf), chosen.get("upper", np.inf)


def told(counts, *margins):
    """Counts, −1 where a margin is small."""
    return np.where(np.min(margins, axis=0) > NEAR, counts, -1)


def five_bar(rng):
    """Gears on gears on an arm: the loop is a dyad; the rotor's limits are those of the arm."""
    a1, a2, a3, a4, c = lengths(rng, 5)
    first, second = ratio(rng), ratio(rng)
    region = box(interval(rng, -9.0, 9.0, 2.0), interval(rng, -3.0, 3.0, 1.5))
    ends = sorted((first * region[0][0], first * region[1][0]))
    held = limits(rng, *ends, share=0.2)
    joints = [
        joint("revolute", "one", "base", **spring(rng)),
        joint("revolute", "two", "base", c),
        joint("revolute", "three", "one_body", a1, **spring(rng)),
        joint("revolute", "four", "two_body", a2),
        joint("revolute", "rotor", "base", 0.3, **held),
        joint("revolute", "wheel", "rotor_body", 0.1, **spring(rng)),
    ]
    gears = (geared("rotor", "one", first), geared("wheel", "rotor", second, name="more"))

    def counts(q):
        gap = c + a2 * np.exp(1j * q[:, 1]) - a1 * np.exp(1j * q[:, 0])
        modes, margin = oracle.dyad(gap, a3, a4)
        kept, near = oracle.within(first * q[:, :1], *bounds(held))
        return told(np.sum(np.isfinite(modes), axis=0) * kept, margin, near)

    made = linkage("five-bar", joints, [pin("three", "four", a3, closure(rng), end=a4)], gears, ["one", "two"])
    return Case(made, region, counts)


def double_slider(rng):
    """A rod between two sliders; half of them driven by a rack's pinion."""
    rod, height = np.sort(lengths(rng, 2))[::-1]
    low, high = interval(rng, -20.0, 20.0, 3.0)
    held = limits(rng, low - rod, high + rod)
    joints = [
        joint("prismatic", "drive", "base", **spring(rng)),
        joint("revolute", "elbow", "drive_body", **spring(rng)),
        joint("prismatic", "slide", "base", y=height, **held),
    ]
    racked, teeth = rng.random() < 0.5, ratio(rng)
    if racked:
        joints.append(joint("revolute", "pinion", "base"))
    gears = (geared("drive", "pinion", 1.0 / teeth),) if racked else ()
    scale = teeth if racked else 1.0
    region = box(tuple(sorted((low * scale, high * scale))))
    made = linkage(
        "double slider", joints, [pin("elbow", "slide", rod, closure(rng))], gears, ["pinion" if racked else "drive"]
    )

    def counts(q):
        along, margin = oracle.on_line(np.full(len(q), height), rod)
        return told(*_with(margin, *oracle.within(q / scale + along, *bounds(held))))

    return Case(made, region, counts)


def rail(rng):
    """A rod from a crank to a slider on a rail that is carried on: in gear with the crank, free, or both carried."""
    crank, across = lengths(rng, 2) * [1.0, 0.5]
    rod = crank + across + rng.uniform(-0.1, 0.4)
    kind = rng.choice(["geared", "free", "carried"], p=[0.4, 0.4, 0.2])
    pitch = ratio(rng) / 10.0
    turning, travel = interval(rng, -6.0, 6.0, 2.0), interval(rng, -20.0, 20.0, 2.0)
    if kind == "geared":
        travel = tuple(sorted(pitch * np.array(turning)))
    lift = interval(rng, -0.1, 0.1, 0.1)
    held = limits(rng, -travel[1] - crank - rod, -travel[0] + crank + rod)
    joints = [
        joint("prismatic", "travel", "base", y=across),
        joint("prismatic", "lift", "base", axis=Y),
        joint("revolute", "crank", "lift_body" if kind == "carried" else "base", **spring(rng)),
        joint("revolute", "elbow", "crank_body", crank, **spring(rng)),
        joint("prismatic", "slide", "travel_body", **held, **spring(rng)),
    ]
    joints = joints if kind == "carried" else [joints[0], *joints[2:]]
    gears = (geared("travel", "crank", pitch),) if kind == "geared" else ()
    chosen = {"geared": ["crank"], "free": ["crank", "travel"], "carried": ["crank", "travel", "lift"]}[kind]
    region = box(turning, travel, lift)
    region = region[0][: len(chosen)], region[1][: len(chosen)]
    made = linkage("rail", joints, [pin("elbow", "slide", rod, closure(rng))], gears, chosen)

    def counts(q):
        carried = pitch * q[:, 0] if kind == "geared" else q[:, 1]
        lifted = q[:, 2] if kind == "carried" else 0.0
        along, margin = oracle.on_line(across - lifted - crank * np.sin(q[:, 0]), rod)
        values = (crank * np.cos(q[:, 0]) - carried)[:, None] + along
        return told(*_with(margin, *oracle.within(values, *bounds(held))))

    return Case(made, region, counts)


def two_carriages(rng):
    """Three carriages in gear, a slider on the last, a rod back to the first."""
    rod = float(lengths(rng, 1)[0])
    first, second = ratio(rng), ratio(rng)
    region = box(interval(rng, -9.0, 9.0, 2.0))
    ends = np.array([(1.0 - first * second) * end[0] for end in region])
    held = limits(rng, ends.min() - rod, ends.max() + rod)
    joints = [
        joint("prismatic", "a", "base", **spring(rng)),
        joint("prismatic", "b", "base"),
        joint("prismatic", "c", "base", **spring(rng)),
        joint("revolute", "elbow", "a_body"),
        joint("prismatic", "slide", "c_body", **held),
    ]
    gears = (geared("b", "a", first), geared("c", "b", second, name="more"))
    made = linkage("carriages", joints, [pin("elbow", "slide", rod, closure(rng))], gears, ["a"])

    def counts(q):
        values = q[:, :1] * (1.0 - first * second) + rod * np.array([[-1.0, 1.0]])
        return told(*oracle.within(values, *bounds(held)))

    return Case(made, region, counts)


def geared_crank(rng):
    """A slider-crank driven through a gear: the crank depends, by the gear, on its motor."""
    crank, rod, across = lengths(rng, 3)
    gear = ratio(rng)
    region = box(interval(rng, -9.0 * abs(gear), 9.0 * abs(gear), 7.0 * abs(gear)))
    held = limits(rng, -crank - rod, crank + rod)
    joints = [
        joint("revolute", "crank", "base"),
        joint("revolute", "elbow", "crank_body", crank, **spring(rng)),
        joint("prismatic", "slide", "base", y=across, **held, **spring(rng)),
        joint("revolute", "motor", "base", 0.2),
    ]
    gears = (geared("motor", "crank", gear),)
    made = linkage("geared crank", joints, [pin("elbow", "slide", rod, closure(rng))], gears, ["motor"])

    def counts(q):
        turned = q[:, 0] / gear
        along, margin = oracle.on_line(across - crank * np.sin(turned), rod)
        return told(*_with(margin, *oracle.within(crank * np.cos(turned)[:, None] + along, *bounds(held))))

    return Case(made, region, counts)


def leg(rng):
    """A leg that turns and slides from an anchor that is carried to a crank's tip: as long as the way, either way."""
    crank, away = lengths(rng, 2)
    region = box(interval(rng, -6.0, 6.0, 2.0), interval(rng, -20.0, 20.0, 2.0))
    held = limits(rng, -22.0, 22.0)
    joints = [
        joint("revolute", "crank", "base", **spring(rng)),
        joint("prismatic", "anchor", "base", y=away),
        joint("revolute", "swing", "anchor_body"),
        joint("prismatic", "stretch", "swing_body", **held, **spring(rng)),
    ]
    made = linkage("leg", joints, [pin("stretch", "crank", 0.0, closure(rng), end=crank)], (), ["crank", "anchor"])

    def counts(q):
        way = np.abs(crank * np.exp(1j * q[:, 0]) - q[:, 1] - 1j * away)
        return told(*_with(way, *oracle.within(way[:, None] * [-1.0, 1.0], *bounds(held))))

    return Case(made, region, counts)


def two_loops(rng):
    """A four-bar whose rocker drives a second one, and a rotor on the rocker, which has limits."""
    crank, coupler, rocker, base, more, second, far = lengths(rng, 7)
    region = box(interval(rng, -4.0, 4.0, 3.0))
    held = range_of(rng.uniform(-3.0, 3.0), rng.uniform(2.0, 7.0))
    joints = [
        joint("revolute", "crank", "base"),
        joint("revolute", "coupler", "crank_body", crank, **spring(rng)),
        joint("revolute", "rocker", "base", base, **held),
        joint("revolute", "second", "rocker_body", more),
        joint("revolute", "last", "base", base + far, **spring(rng)),
        joint("revolute", "rotor", "base", 0.5, **spring(rng)),
    ]
    closures = [
        pin("coupler", "rocker", coupler, closure(rng), "first", end=rocker),
        pin("second", "last", second, closure(rng), "second", end=rocker),
    ]
    made = linkage("two loops", joints, closures, (geared("rotor", "rocker", ratio(rng)),), ["crank"])

    def counts(q):
        gap = crank * np.exp(1j * q[:, 0]) - base
        angles, margin = oracle.dyad(gap, rocker, coupler)
        total, margins = np.zeros(len(q)), [margin]
        for angle in angles:
            modes, close = oracle.dyad(far - more * np.exp(1j * angle), rocker, second)
            kept, near = oracle.turned_within(angle[:, None], **held)
            there = np.isfinite(angle)
            total += np.where(there, np.sum(np.isfinite(modes), axis=0) * kept, 0)
            margins += [np.where(there, close, np.inf), np.where(there, near, np.inf)]
        return told(total, *margins)

    return Case(made, region, counts)


def _five_bar(rng, name, sizes, gear, **held):
    """Arms a₁, a₃ from the origin and a₂, a₄ from c, a gear between two of their joints, the first elbow held so."""
    a1, a2, a3, a4, c = sizes
    joints = [
        joint("revolute", "one", "base"),
        joint("revolute", "two", "base", c, **spring(rng)),
        joint("revolute", "three", "one_body", a1, **held),
        joint("revolute", "four", "two_body", a2, **spring(rng)),
    ]
    return linkage(name, joints, [pin("three", "four", a3, closure(rng), end=a4)], (gear,), ["one"])


def geared_five_bar(rng):
    """A five-bar whose second arm is geared to the first, over some turns."""
    a1, a2, a3, a4, c = lengths(rng, 5)
    gear, offset = ratio(rng), rng.uniform(-1.0, 1.0)
    region = box(interval(rng, -9.0, 9.0, 8.0 / max(1.0, abs(gear) / 4.0)))
    made = _five_bar(rng, "geared five-bar", (a1, a2, a3, a4, c), geared("two", "one", gear, offset))

    def counts(q):
        gap = c + a2 * np.exp(1j * (gear * q[:, 0] + offset)) - a1 * np.exp(1j * q[:, 0])
        modes, margin = oracle.dyad(gap, a3, a4)
        return told(np.sum(np.isfinite(modes), axis=0), margin)

    return Case(made, region, counts)


def geared_elbows(rng):
    """A five-bar with both elbows in gear, within limits: one equation of the first elbow is left to be searched."""
    a1, a2, a3, a4, c = lengths(rng, 5)
    gear, offset = float(np.clip(ratio(rng), -6.0, 6.0)), rng.uniform(-1.0, 1.0)
    region = box(interval(rng, -3.0, 3.0, 2.0))
    held = range_of(rng.uniform(-2.0, 2.0), rng.uniform(1.0, 4.0))
    made = _five_bar(rng, "geared elbows", (a1, a2, a3, a4, c), geared("four", "three", gear, offset), **held)

    def counts(q):
        found = []
        for turned in q[:, 0]:
            stem, bend = a1 * np.exp(1j * turned) - c, a3 * np.exp(1j * turned)

            def gap(x, stem=stem, bend=bend):
                return abs(stem + bend * np.exp(1j * x)) ** 2 - abs(a2 + a4 * np.exp(1j * (gear * x + offset))) ** 2

            def slope(x, stem=stem, bend=bend):
                first = 2.0 * (np.conj(stem) * 1j * bend * np.exp(1j * x)).real
                return first + 2.0 * a2 * a4 * gear * np.sin(gear * x + offset)

            most = 2.0 * abs(stem) * a3 + 2.0 * a2 * a4 * gear**2
            found.append(oracle.zeros_between(gap, slope, most, **held))
        return np.array(found)

    return Case(made, region, counts, searched=True)


def _with(margin, counts, near):
    return counts, margin, near


FAMILIES = (
    five_bar,
    double_slider,
    rail,
    two_carriages,
    geared_crank,
    leg,
    two_loops,
    geared_five_bar,
    geared_elbows,
)

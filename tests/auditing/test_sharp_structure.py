"""What documents must be before anything of them is proved: each hypothesis at the number at which it ends."""

from copy import deepcopy

import numpy as np
import pytest

pytest.importorskip("flint")

from ccpin.auditing import structure
from ccpin.auditing.structure import ContradictionError

BIG, MAX = 1e9, np.finfo(float).max


def tilted(by):
    """A turn about z, its first column longer by a half of `by` to first order: RᵀR is off by `by`."""
    rotation = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    rotation[1, 0] += 0.5 * by
    return rotation


def document():
    """Coordinates: 0, 1, 2 turns, 3 a slide, 4 coupled, 5 of a rod, 6 of a closure; two chains, a row modulo 6."""
    chain = {
        "joints": np.array([0, 1]),
        "rotations": np.array([np.eye(3), tilted(0.0)]),
        "translations": np.zeros((2, 3)),
        "axes": np.array([[1.0, 0.0, 0.0], [0.0, 0.6, 0.8]]),
        "prismatic": np.zeros(2, dtype=bool),
        "tip": np.zeros(3),
        "direction": np.zeros((), dtype=bool),
        "weights": np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]),
    }
    other = deepcopy(chain) | {"joints": np.array([2, 3]), "prismatic": np.array([False, True])}
    arrays = {f"chain{k}_{name}": value for k, c in enumerate((chain, other)) for name, value in c.items()}
    couplings = np.zeros((3, 7))
    couplings[2, 4] = 2.0
    arrays |= {
        "system_couplings": couplings,
        "system_offset": np.zeros(3),
        "system_moduli": np.array([0.0, 0.0, 6.0]),
        "system_independent": np.array([0, 1, 6]),
        "system_dependent": np.array([2, 3, 4, 5]),
        "system_periodic": np.array([True, True, True, False, False, True, True]),
        "demand_lower": np.full(7, -MAX),
        "demand_upper": np.full(7, MAX),
        "demand_driven": np.array([2, 3, 4]),
        "demand_units": np.array([1.0, 2.0, BIG]),
        "demand_dexterity": np.array(0.0),
        "lower": np.array([-np.pi, 1.0, -BIG]),
        "upper": np.array([-np.pi + 2.0 * np.pi, 1.0, BIG]),
        "wrapped": np.array([True, False, False]),
        "ranges_lower": np.array([-1.0, -1.0, -1.0]),
        "rod0_axes_a": np.zeros((1, 3)),
        "rod0_axes_b": np.zeros((0, 3)),
    }
    header = {
        "chains": 2,
        "joints": [
            ["arm", "revolute", 0, 1, 0, 1],
            ["ball", "spherical", 1, 5, 1, 4],
            ["turn", "revolute", 5, 7, 4, 5],
        ],
        "nq": 7,
        "n_free": 5,
        "rods": [{"place": [5, 6], "length": 1.0, "steps_a": [[True, 4]], "steps_b": []}],
        "names": ["arm", "ball:x", "closure"],
    }
    return header, arrays


def at(name, place, value):
    def change(header, arrays):
        arrays[name][place] = value

    return change


def to(name, value):
    def change(header, arrays):
        (header if name in header else arrays)[name] = value

    return change


def rod(name, value):
    return lambda header, arrays: header["rods"][0].update({name: value})


def joint(k, value):
    return lambda header, arrays: header["joints"].__setitem__(k, value)


def joints(entries, nq, n_free):
    return lambda header, arrays: header.update(joints=entries, nq=nq, n_free=n_free)


SYSTEM = [
    (to("system_dependent", np.array([2, 3, 4])), "overlap or leave"),
    (to("system_dependent", np.array([2, 3, 4, 6])), "overlap or leave"),
    (to("system_moduli", np.array([0.0, 0.0, -1e-300])), "negative"),
    (to("system_moduli", np.array([0.0, -1.0, 6.0])), "negative"),
    *[(at(name, 0, 1.1 * BIG), name) for name in ("system_couplings", "system_offset", "system_moduli")],
    *[(at(name, 0, -1.1 * BIG), name) for name in ("system_couplings", "system_offset")],
    (at("system_offset", 0, BIG), None),
    (at("system_offset", 0, -BIG), None),
    *[
        (at(f"chain{k}_{name}", 0, 1.1 * BIG), f"chain{k}_{name} holds")
        for k in (0, 1)
        for name in ("rotations", "axes", "translations", "tip", "weights")
    ],
    (to("chain0_joints", np.array([1, 1])), "chain0_joints names a joint twice"),
    (to("chain1_joints", np.array([3, 3])), "chain1_joints names a joint twice"),
    (to("chain0_joints", np.zeros(0, dtype=int)), "chain0_joints names a joint twice, or none"),
    (at("chain0_joints", 0, -1), "chain0_joints names coordinates"),
    (at("chain0_joints", 0, 7), "chain0_joints names coordinates"),
    (at("chain0_joints", 0, 6), None),
    (at("chain1_rotations", 0, tilted(0.95e-12)), None),
    (at("chain1_rotations", 0, tilted(1.05e-12)), "chain1_rotations are no"),
    (at("chain1_rotations", 1, tilted(1.05e-12)), "chain1_rotations are no"),
    (at("chain0_rotations", 1, np.diag([1.0, 1.0, -1.0])), "chain0_rotations are no"),
    (at("chain0_rotations", 0, -np.eye(3)), "chain0_rotations are no"),
    *[(at("chain0_axes", 0, [1.0 + s * 0.95e-12, 0.0, 0.0]), None) for s in (-1, 1)],
    *[(at("chain0_axes", 0, [1.0 + s * 1.05e-12, 0.0, 0.0]), "chain0_axes") for s in (-1, 1)],
    (at("chain1_axes", 1, [0.0, 0.5, 0.5]), "chain1_axes"),
    (at("chain1_weights", (2, 1), 1.0), "chain1_weights enter a row"),
    (at("chain0_weights", (2, 0), -1.0), "chain0_weights enter a row"),
    (at("system_periodic", 3, True), "system_periodic"),
    (at("system_periodic", 4, True), "system_periodic"),
    (at("demand_lower", 1, -3.0), "system_periodic"),
    (at("demand_upper", 2, 3.0), "system_periodic"),
    (at("demand_lower", 2, -0.9 * MAX), "system_periodic"),
    (at("demand_lower", 3, -3.0), None),
]
CHART = [
    (joint(1, ["arm", "spherical", 1, 5, 1, 4]), "two have one name"),
    (joint(0, ["arm", "revolute", 1, 2, 0, 1]), "'arm' does not follow"),
    (joint(0, ["arm", "revolute", 0, 1, 1, 2]), "'arm' does not follow"),
    (joint(1, ["ball", "spherical", 1, 4, 1, 4]), "'turn' does not follow"),
    (joint(1, ["ball", "spherical", 1, 6, 1, 4]), "'ball' does not follow"),
    (joint(1, ["ball", "spherical", 1, 3, 1, 4]), "'ball' does not follow"),
    (joints([["a", "b", 0, 6, 0, 6]], 6, 6), "'rods' do not follow"),
    (joints([["a", "b", 0, 7, 0, 7]], 7, 7), "'a' does not follow"),
    (joints([["a", "b", 0, 0, 0, 0]], 0, 0), "'a' does not follow"),
    (joints([["a", "b", 0, 1, 0, 0]], 1, 0), "'a' does not follow"),
    (to("nq", 6), "'nq' and 'n_free'"),
    (to("n_free", 6), "'nq' and 'n_free'"),
    (rod("place", [4, 5]), "'rods' do not follow"),
    (rod("place", [5, 5]), "'rods' do not follow"),
    (rod("place", [5, 7]), "'closure' is not"),
    (rod("place", [5, 8]), "'rods' do not follow"),
    (rod("place", [6, 7]), "'rods' do not follow"),
    (rod("length", 0.0), "length"),
    (rod("length", 1e-300), None),
    (rod("steps_a", [[True, 5]]), "coordinates that are none"),
    (rod("steps_b", [[True, 4]]), "the steps are not"),
    (rod("steps_a", []), "the steps are not"),
    (to("rod0_axes_b", np.zeros((1, 3))), "the steps are not"),
    (to("names", ["arm", "ball:x"]), "not as many"),
    (to("names", ["leg", "ball:x", "closure"]), "'leg' is not what"),
    (to("names", ["arm", "ball", "closure"]), "'ball' is not what"),
    (to("names", ["arm", "ball:x", "ball:y"]), None),  # of closures nothing is said
    (to("system_independent", np.array([0, 3, 6])), None),
    (to("system_independent", np.array([0, 4, 6])), "'ball:x' is not what"),
    (to("system_independent", np.array([0, 1, 5])), "'closure' is not what"),
    (to("system_independent", np.array([0, 1, 4])), "'closure' is not what"),
    (
        lambda h, a: (
            rod("place", [5, 7])(h, a),
            h.update(names=["arm", "ball:x"], n=2),
            a.update(system_independent=np.array([0, 1]), system_couplings=np.zeros((3, 6))),
        ),
        "more coordinates than",
    ),
]
REGION = [
    (at("lower", 0, np.nextafter(-np.pi, 0.0)), "wrapped"),
    (at("system_periodic", 0, False), "wrapped"),
    (at("wrapped", 2, True), "wrapped"),
    (at("wrapped", 0, False), None),
    (at("lower", 1, 1.0 + 1e-15), "no region"),
    (at("lower", 1, 2.0), "no region"),
    (lambda h, a: a.update(lower=a["upper"].copy(), wrapped=np.zeros(3, dtype=bool)), "no region"),
    (lambda h, a: a.update(lower=np.full(3, -1.0), upper=np.full(3, -0.9), wrapped=np.zeros(3, dtype=bool)), None),
    (lambda h, a: a.update(lower=np.full(3, 0.9), upper=np.full(3, 1.0), wrapped=np.zeros(3, dtype=bool)), None),
    *[(at(name, 2, value), name) for name, value in (("lower", -1.1 * BIG), ("upper", 1.1 * BIG))],
    *[
        (to(name, np.array([0.0, 1.1 * BIG, 0.0])), name)
        for name in ("ranges_lower", "ranges_upper", "range_lower", "range_upper")
    ],
]
DEMANDS = [
    (lambda h, a: [a.pop(name) for name in list(a) if name.startswith("demand_")], None),
    (lambda h, a: (at("demand_lower", 3, 1.0)(h, a), at("demand_upper", 3, 0.999)(h, a)), "is above"),
    (lambda h, a: (at("demand_lower", 3, 1.0)(h, a), at("demand_upper", 3, 1.0)(h, a)), None),
    (at("demand_driven", 0, -1), "names coordinates"),
    (at("demand_driven", 0, 7), "names coordinates"),
    (at("demand_driven", 0, 6), None),
    (at("demand_driven", 0, 0), None),
    (at("demand_driven", 0, 3), "twice"),
    (at("demand_units", 0, 0.0), "demand_units"),
    (at("demand_units", 2, -1.0), "demand_units"),
    (at("demand_units", 0, 1.01 * BIG), "demand_units"),
    (to("demand_dexterity", np.array(-1e-300)), "demand_dexterity"),
    (to("demand_dexterity", np.array(1.0)), "demand_dexterity"),
    (to("demand_dexterity", np.array(0.999)), None),
]
CHECKS = {
    structure.check_closures: SYSTEM,
    structure.check_chart: CHART,
    lambda header, arrays: structure.check_region(arrays): REGION,
    lambda header, arrays: structure.check_demands(arrays): DEMANDS,
}


@pytest.mark.parametrize(
    ("check", "change", "fault"),
    [
        pytest.param(check, change, fault, id=f"{name}-{k}-{fault}")
        for name, (check, rows) in zip(("system", "chart", "region", "demands"), CHECKS.items(), strict=True)
        for k, (change, fault) in enumerate([(lambda header, arrays: None, None), *rows])
    ],
)
def test_hypotheses_end_where_they_say(check, change, fault):
    header, arrays = document()
    change(header, arrays)
    if fault is None:
        check(header, arrays)
    else:
        with pytest.raises(ContradictionError, match=fault):
            check(header, arrays)


def test_places_in_range():
    assert structure.in_range(np.array([0, 2]), 3)
    assert structure.in_range(np.zeros(0, dtype=int), 0)
    assert not structure.in_range(np.array([0, 3]), 3)
    assert not structure.in_range(np.array([-1, 2]), 3)

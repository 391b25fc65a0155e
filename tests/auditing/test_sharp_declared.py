"""What a document may be called, hold and be shaped like: whatever is declared passes, whatever else is refused."""

import numpy as np
import pytest

from ccpin.auditing import declared
from ccpin.errors import InvalidInputError

SIZES = {"m": 2, "n": 3, "p": 5, "x": 7} | {letter: k for k, letter in enumerate("BNSUMGLTVCdkab", 8)}
ROD = {"place": [5, 6], "length": 1.0, "steps_a": [[True, 1], [False, 2]], "steps_b": []}
KINDS = {"f": float, "i": int, "b": bool}


def made(tables):
    """Arrays of the forms declared."""
    found = {}
    for prefix, table in tables:
        for name, form in table.items():
            kind, *shape = form.split()
            sizes = [int(s) if s.isdigit() else SIZES[s] + (s in "kab" and "1" in prefix) for s in shape]
            found[prefix + name] = np.zeros(sizes, dtype=KINDS[kind])
    return found


FORMS = {
    kind: made(
        [
            ("", declared._SYSTEM),
            ("", declared._OF[kind]),
            *((f"chain{k}_", declared._CHAIN) for k in range(2)),
            ("joint0_", declared._JOINT),
            ("rod0_", declared._ROD),
            ("rod1_", declared._ROD),
        ]
    )
    for kind in (declared.ATLAS, declared.SHEETS, declared.CURVES)
}
DEMANDS = made([("", declared._DEMANDS)])
OWN = {
    declared.ATLAS: {"radius": 0.5, "complete": True},
    declared.SHEETS: {"complete": False},
    declared.CURVES: {"tried": 3, "limit": None, "resolution": 0.1},
}


def document(kind):
    header = {
        "format": kind,
        "theorem": "",
        "fingerprint": "",
        "checksum": "",
        "rods": [dict(ROD), dict(ROD)],
        "chains": 2,
        "nq": 1,
        "n_free": 1,
        "joints": [["a", "b", 0, 1, 0, 1]],
        "planar": True,
        "names": ["a", "b"],
    }
    return header | OWN[kind], dict(FORMS[kind])


def passes(header, arrays):
    declared.refuse_others(header, arrays, "file")


def refused(header, arrays, fault):
    with pytest.raises(InvalidInputError, match=fault):
        passes(header, arrays)


@pytest.mark.parametrize("kind", FORMS)
def test_what_is_declared_passes_and_nothing_is_missing_or_more(kind):
    passes(*document(kind))
    for name in FORMS[kind]:
        header, arrays = document(kind)
        array = arrays.pop(name)
        refused(header, arrays, f"lacks '{name}'|not as many chains, joints and rods")
        for other in (np.zeros((*array.shape, 1), array.dtype), array.astype(np.uint8)):
            refused(header, arrays | {name: other}, name)
    for name in document(kind)[0]:
        header, arrays = document(kind)
        del header[name]
        refused(header, arrays, "lacks" if name != "format" else "the format is")
    header, arrays = document(kind)
    refused(header | {"more": 1}, arrays, "holds 'more'")
    refused(header, arrays | {"more": np.zeros(1)}, "holds 'more'")


@pytest.mark.parametrize("kind", FORMS)
def test_demands_are_of_an_atlas_alone_and_all_or_none(kind):
    header, arrays = document(kind)
    if kind == declared.ATLAS:
        passes(header, arrays | DEMANDS)
        for name in DEMANDS:
            refused(header, arrays | {n: a for n, a in DEMANDS.items() if n != name}, f"lacks '{name}'")
    else:
        refused(header, arrays | DEMANDS, "holds 'demand_")


@pytest.mark.parametrize("kind", FORMS)
def test_letters_stand_for_one_size(kind):
    """In a whole document, and chains' and rods' own in these alone."""
    for name, array in FORMS[kind].items():
        for axis in range(array.ndim):
            header, arrays = document(kind)
            shape = list(array.shape)
            shape[axis] += 1
            arrays[name] = np.zeros(shape, array.dtype)
            letters = {**declared._SYSTEM, **declared._OF[kind]}.get(name, "- - - -").split()[1:]
            alone = letters[axis : axis + 1] and letters[axis] in "USMGLVC" and _count(kind, letters[axis]) == 1
            if alone:
                passes(header, arrays)
            else:
                refused(header, arrays, "shape|tubes are not|are independent")


def _count(kind, letter):
    return sum(form.split().count(letter) for form in declared._OF[kind].values())


@pytest.mark.parametrize("header", [{"format": "other"}, {"format": 1}, {"format": ["x"]}, {"format": None}])
def test_other_formats_are_refused(header):
    refused(document(declared.ATLAS)[0] | header, dict(FORMS[declared.ATLAS]), "the format is")


def test_more_parts_than_arrays_are_refused_before_they_are_listed():
    header, arrays = document(declared.ATLAS)
    count = len(arrays) - 3
    refused(header | {"chains": count}, arrays, "lacks")
    refused(header | {"chains": count + 1}, arrays, "not as many chains, joints and rods")


@pytest.mark.parametrize(
    ("m", "n", "p", "x", "good"),
    [(1, 1, 2, 3, True), (0, 1, 1, 1, False), (1, 0, 1, 2, False), (1, 1, 3, 4, False), (2, 1, 3, 4, False)],
)
def test_sizes_go_together(m, n, p, x, good):
    sizes = {"m": m, "n": n, "p": p, "x": x}
    if good:
        declared._refuse_sizes(declared.CURVES, sizes, "file")
    else:
        with pytest.raises(InvalidInputError):
            declared._refuse_sizes(declared.CURVES, sizes, "file")
    if p == m + n >= 2 and min(m, n) >= 1:
        declared._refuse_sizes(declared.ATLAS, sizes, "file")


def rods(**changed):
    return [dict(ROD), {**ROD, **changed}]


@pytest.mark.parametrize(
    ("name", "good", "bad"),
    [
        ("theorem", ["x"], [1, None, ["x"]]),
        ("planar", [True], [1, "x", None]),
        ("chains", [2], [2.0, True, "2", -1, 2**62]),
        ("nq", [0, 2**62 - 1], [1.0, True, -1, 2**62, None]),
        ("radius", [0, 0.5, 1e300, 1.2e308], [float("inf"), float("nan"), -float("inf"), True, "1", None]),
        ("names", [[], ["a"]], ["ab", None, ["a", 1], [1, "a"], [1, 2], ["a", "a"], {"a": 1}]),
        (
            "joints",
            [[["a", "b", 0, 0, 0, 0]], [["a", "b", 1, 2, 3, 4]]],
            [
                None,
                {"a": 1},
                ["abcdef"],
                [("a", "b", 0, 1, 0, 1)],
                [["a", "b", 0, 1, 0]],
                [["a", "b", 0, 1, 0, 1, 1]],
                [["a", 1, 0, 1, 0, 1]],
                [[1, "a", 0, 1, 0, 1]],
                [["a", "b", -1, 1, 0, 1]],
                [["a", "b", 0, 1, 0, 1.0]],
                [["a", "b", 0, 1, 0, 1], []],
                [[], ["a", "b", 0, 1, 0, 1]],
            ],
        ),
        (
            "rods",
            [rods(place=[0, 1]), rods(steps_b=[[False, 0]])],
            [
                None,
                {"a": 1},
                [dict(ROD), 1],
                [1, dict(ROD)],
                rods(more=1),
                [dict(ROD), {name: value for name, value in ROD.items() if name != "length"}],
                rods(place=(0, 1)),
                rods(place=[0]),
                rods(place=[0, 1, 2]),
                rods(place=[0, -1]),
                rods(place=[0.0, 1]),
                rods(length="1"),
                rods(length=float("inf")),
                *(
                    rods(**{f"steps_{end}": steps})
                    for end in "ab"
                    for steps in (None, {}, [1], [[True]], [[True, 1, 1]], [[1, 1]], [[True, 1.0]], [(True, 1)])
                ),
                rods(steps_a=[[True, 1], [True, -1]]),
                rods(steps_a=[[True, -1], [True, 1]]),
            ],
        ),
    ],
)
def test_fields_of_a_header(name, good, bad):
    for value in good:
        assert {**declared._HEADER, **declared._HEADER_OF[declared.ATLAS]}[name](value)
    for value in bad:
        header, arrays = document(declared.ATLAS)
        refused(header | {name: value}, arrays, f"'{name}' in the header is")


@pytest.mark.parametrize(
    ("name", "good", "bad"),
    [
        ("limit", [None, "budget", "interrupted"], ["other", 1]),
        ("resolution", [1e-300, 1], [0, 0.0, -1.0, float("inf"), "x"]),
        ("tried", [0], [-1, 0.5]),
    ],
)
def test_fields_of_curves(name, good, bad):
    for value in good:
        header, arrays = document(declared.CURVES)
        passes(header | {name: value}, arrays)
    for value in bad:
        header, arrays = document(declared.CURVES)
        refused(header | {name: value}, arrays, f"'{name}' in the header is")

"""What an audit says: of what was found, what holds; which claims there are; and that all boxes are reached."""

import json
from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest

import ccpin
from ccpin.domain import certify
from ccpin.errors import InvalidInputError

pytest.importorskip("flint")

from ccpin.auditing import (
    audit,
    container,
    findings,
    gluing,
    looking,
    verify,
    wording,
)
from ccpin.auditing.audit import AuditProgress
from ccpin.auditing.findings import Audit, Claim
from ccpin.auditing.reading import ClaimedDocument, Curves, Faces, StatedRanges

MAX = np.finfo(float).max


def blank(kind):
    """The fields of a document without anything in them."""
    return dict.fromkeys(field.name for field in fields(kind))


def said(*claims):
    return Audit("theorem", "f" * 64, claims, "nothing", "all of it")


PROVED, HALF = Claim("a", 2, 2, ()), Claim("b", 4, 2, ())
FALSE, OPEN = Claim("c", 2, 2, ((1,),)), Claim("d", 2, 2, (), ((1,), (2, 3)))


def test_what_holds_is_proved_refuted_or_neither():
    for claims, holds, refuted, whole in (
        ((), True, False, True),
        ((PROVED,), True, False, True),
        ((PROVED, HALF), True, False, False),
        ((HALF, PROVED), True, False, False),
        ((PROVED, FALSE), False, True, True),
        ((FALSE, OPEN), False, True, True),
        ((PROVED, OPEN), False, False, True),
    ):
        found = said(*claims)
        assert (found.holds, found.refuted, found.whole) == (holds, refuted, whole)


def test_an_audit_in_words():
    many = Claim("e", 20, 20, tuple((k,) for k in range(9)), tuple((k, k) for k in range(8)))
    text = str(said(PROVED, HALF, FALSE, OPEN, many))
    assert "a: 2 proved of 2 looked at\n" in text
    assert "b: 2 proved of 2 looked at of 4" in text
    assert "c: 1 proved of 2 looked at\n  FALSE: 1\n" in text
    assert "d: 0 proved of 2 looked at\n  not decided: 1, (2, 3)\n" in text
    assert "e: 3 proved of 20 looked at\n  FALSE: 0, 1, 2, 3, 4, 5, 6, 7, …\n" in text
    assert "not decided: (0, 0), (1, 1), (2, 2), (3, 3), (4, 4), (5, 5), (6, 6), (7, 7)\n" in text


def found_of(kind, *answers):
    found = findings.Outcomes({kind: list(range(99)), "glue": []})
    for k, (good, seen) in enumerate(answers):
        found.add(kind, (k,), good, seen)
    return found


@pytest.mark.parametrize(("kind", "undecided"), [("box", 8), ("tube", 8), ("empty", 2), ("count", 2), ("cover", 2)])
def test_eight_that_are_not_proved_are_enough(kind, undecided):
    """Two where a search has ended without an answer; what there is no way to look at does not count."""
    wrong, open_ = [(False, True)], [(None, True)]
    assert not found_of(kind, *7 * wrong).enough(kind)
    assert found_of(kind, *8 * wrong).enough(kind)
    assert not found_of(kind, *(undecided - 1) * open_).enough(kind)
    assert found_of(kind, *undecided * open_).enough(kind)
    assert not found_of(kind, *50 * [(True, True)], *50 * [(None, False)]).enough(kind)
    claim = found_of(kind, (True, True), (None, False), (False, True), *20 * wrong).claim(kind)
    assert (claim.of, claim.checked) == (99, 9)
    assert claim.failed == tuple((k,) for k in range(2, 10))
    assert claim.undecided == ()
    claim = found_of(kind, (True, True), (None, True), (False, True)).claim(kind)
    assert (claim.checked, claim.failed, claim.undecided) == (3, ((2,),), ((1,),))


def test_claims_of_curves(monkeypatch):
    """Each tube goes on in the next of its curve; of closed ones the last in the first."""
    monkeypatch.setattr(looking, "parts", lambda closures, document: range(5))
    monkeypatch.setattr("ccpin.auditing.looking.BallClosures", lambda document: None)
    document = SimpleNamespace(
        sizes=np.array([3, 1, 2, 1]), closed=np.array([True, False, False, True]), tubes=range(7)
    )
    kinds = looking._of_curves(document)
    assert kinds["joint"] == [(0, 1), (1, 2), (2, 0), (4, 5), (6, 6)]
    assert kinds["tube"] == kinds["once"] == list(range(7))
    assert kinds["cover"] == list(range(5))
    document.sizes, document.closed, document.tubes = np.array([2]), np.array([False]), range(2)
    assert looking._of_curves(document)["once"] == []
    document.sizes, document.closed = np.array([1, 1]), np.array([False, False])
    assert looking._of_curves(document)["once"] == [0, 1]


def test_faces_are_all_but_those_unglued_or_those_that_are_said(monkeypatch):
    every = [gluing.SharedFace(a, b, None, None) for a, b in ((0, 1), (2, 1), (2, 3))]
    monkeypatch.setattr(looking, "contacts", lambda document: iter(every))
    document = SimpleNamespace(faces=None, unglued=np.array([[1, 2], [5, 6]]))
    assert looking._faces(document) == [every[0], every[2]]
    document.faces = Faces(np.array([4]), np.array([6]), np.array([[7.0, 1.0]]), np.array([[1.0, 1.0]]))
    (face,) = looking._faces(document)
    assert (face.first, face.second, face.middle.tolist(), face.turn.tolist()) == (4, 6, [7.0, 1.0], [6.0, 0.0])


def test_samples():
    assert audit._chosen(5, None, 0).tolist() == audit._chosen(5, 5, 0).tolist() == audit._chosen(5, 9, 3).tolist()
    for size in (1, 3, 4):
        some = audit._chosen(5, size, 1).tolist()
        assert len({*some}) == size
        assert some == sorted(some)
    assert len({tuple(audit._chosen(50, 3, seed)) for seed in range(9)}) > 5


def test_every_kind_is_looked_at_by_what_proves_it(monkeypatch):
    """And what the two boxes of different sheets have in common is refuted."""
    told = {}

    def answer(name):
        return lambda *args: told[name]

    for name in ("proved", "counted", "goes_on", "listed_once", "one_curve", "met", "same_solution", "singular"):
        monkeypatch.setattr(looking, name, answer(name))
    cells = SimpleNamespace(proved=answer("cells"), searched=True)
    numbers = SimpleNamespace(number=np.array([7, 8, 9]))
    document = SimpleNamespace(empty=numbers, singular=numbers, counts=SimpleNamespace(cells=numbers))
    face = gluing.SharedFace(4, 5, None, None)
    of = {"box": ("proved", 3, (3,)), "glue": ("same_solution", face, (4, 5)), "singular": ("singular", 1, (8,)),
          "demand": ("met", 3, (3,)), "tube": ("one_curve", 3, (3,)), "joint": ("goes_on", (3, 4), (3, 4)),
          "once": ("listed_once", 3, (3,)), "cover": ("cells", 3, (3,)), "empty": ("cells", 2, (9,)),
          "count": ("counted", 2, (9,))}  # fmt: skip
    for searched in (True, False):
        cells.searched = searched
        for good in (True, False, None):
            told.update(dict.fromkeys([name for name, _, _ in of.values()], good))
            looks = looking._looks(looking._OpenDocument(document, None, cells))
            assert {*looks} == {*of, "apart"}
            for kind, (_, what, which) in of.items():
                seen = {"count": searched, "empty": searched or good is not None}.get(kind, True)
                assert looks[kind](what) == (which, good, seen)
            assert looks["apart"](face) == ((4, 5), None if good is None else not good, True)


@pytest.fixture
def held(monkeypatch):
    """Four boxes, of which the first holds the seed; where a solution near it is found."""
    monkeypatch.setattr("ccpin.auditing.looking.BallClosures", lambda document: None)
    at = SimpleNamespace(found=(np.array([1.0, 2.0]), 1e-12), tubes={0})
    monkeypatch.setattr(looking, "near", lambda closures, dependent, theta: at.found)
    monkeypatch.setattr(looking, "in_tube", lambda document, k, theta, radius, turn: k in at.tubes or None)
    at.document = SimpleNamespace(centre=np.zeros((4, 2)), independent=np.array([0]), dependent=np.array([1]))
    return at


def reached(held, pairs, seed=(1.0, 2.0)):
    claim = looking.reached(held.document, np.array(seed), pairs)
    assert (claim.of, claim.checked) == (4, 4)
    return [k for (k,) in claim.failed], [k for (k,) in claim.undecided]


def test_boxes_are_reached_over_faces(held):
    assert reached(held, [(0, 1), (1, 2), (2, 3)]) == ([], [])
    assert reached(held, [(3, 0), (1, 2), (2, 3)]) == ([], [])
    assert reached(held, [(1, 0), (2, 3)]) == ([2, 3], [])
    assert reached(held, []) == ([1, 2, 3], [])
    held.tubes = {0, 3}
    assert reached(held, [(2, 3)]) == ([1], [])
    held.tubes = set()
    assert reached(held, [(0, 1), (1, 2), (2, 3)]) == ([], [0, 1, 2, 3])


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("k", [0, 1])
def test_the_seed_is_a_solution_to_a_billionth(held, sign, k):
    every = [(0, 1), (1, 2), (2, 3)]
    for off, good in ((0.95e-9, True), (1.05e-9, False)):
        seed = np.array([1.0, 2.0])
        seed[k] += sign * off
        assert reached(held, every, seed) == (([], []) if good else ([], [0, 1, 2, 3]))
    held.found = None
    assert reached(held, every) == ([], [0, 1, 2, 3])


@pytest.fixture(scope="module")
def atlas(tmp_path_factory):
    path = tmp_path_factory.mktemp("audit") / "atlas.json"
    certify(ccpin.load("four_bar"), (0.7,), ((0.6,), (0.8,)), max_depth=2).save(path)
    return path


def test_an_audit_asks_what_it_is_to(atlas):
    """Samples of one and more, progress that can be called, a claim that the boxes are reached."""
    done = []
    whole = verify(atlas, progress=done.append)
    assert whole.holds
    assert whole.whole
    assert done == [AuditProgress(k + 1, len(done)) for k in range(len(done))]
    assert [claim.what.split()[0] for claim in whole.claims] == ["boxes", "shared", "boxes"]
    assert verify(atlas, sample=1).claims[0].checked == 1
    for sample in (0, -1):
        with pytest.raises(InvalidInputError, match="at least 1"):
            verify(atlas, sample=sample)
    with pytest.raises(InvalidInputError, match="must be a function"):
        verify(atlas, progress=3)


def test_claims_are_chosen_apart_and_those_without_any_are_left_out(monkeypatch):
    """Kinds that are always told, kinds that there are; of sheets no seed; ranges where they are stated."""
    chosen = []
    monkeypatch.setattr(audit, "_chosen", lambda count, sample, seed: chosen.append((count, seed)) or range(count))
    monkeypatch.setattr(looking, "results", lambda *_: [])
    monkeypatch.setattr(looking, "reached", lambda document, seed, pairs: "reached")
    monkeypatch.setattr(looking, "ranged", lambda document: "ranged")
    monkeypatch.setattr(wording, "claimed", lambda document: "")
    monkeypatch.setattr(wording, "besides", lambda document: "")
    kinds = {"box": [1], "glue": [], "apart": [], "empty": [1, 2], "demand": []}
    monkeypatch.setattr(looking, "_of_cells", lambda document: kinds)
    monkeypatch.setattr(looking, "_of_curves", lambda document: {"tube": []})
    fields = blank(ClaimedDocument) | {"header": {"theorem": "", "fingerprint": ""}}
    tubes = blank(Curves) | {"header": fields["header"], "ranges": 1}
    for document, expected in (
        (ClaimedDocument(**fields), ["box", "glue", "empty"]),
        (ClaimedDocument(**fields | {"seed": np.zeros(1)}), ["box", "glue", "reached", "empty"]),
        (ClaimedDocument(**fields | {"ranges": 1}), ["box", "glue", "empty", "ranged"]),
        (Curves(**tubes), ["tube", "ranged"]),
    ):
        monkeypatch.setattr(audit, "read", lambda path, document=document: document)
        chosen.clear()
        told = verify("", seed=40).claims
        words = {word: kind for kind, word in findings._WORDS.items()}
        assert [claim if isinstance(claim, str) else words[claim.what] for claim in told] == expected
        sizes = [0] if isinstance(document, Curves) else [1, 0, 0, 2, 0]
        assert chosen == [(size, 40 + k) for k, size in enumerate(sizes)]


def test_work_is_shared_and_ends_where_there_is_enough(monkeypatch):
    """Alone, and by processes: all tasks, in their order; of a kind that there is enough of nothing is asked."""
    monkeypatch.setattr(looking._OpenDocument, "of", staticmethod(lambda document: document))
    monkeypatch.setattr(looking, "_checked", lambda held, tasks: [(kind, (what,), held, True) for kind, what in tasks])
    found = findings.Outcomes({"box": [], "glue": []})
    found._open["glue"] = 8 * [((0,), False)]
    tasks = [("box", 1), ("glue", 2), ("box", 3)]
    told = [row for part in looking.results("held", tasks, 1, found) for row in part]
    assert told == [("box", (1,), "held", True), ("glue", (), None, False), ("box", (3,), "held", True)]

    class Pool:
        def __init__(self, workers, context, begin, given):
            begin(*given)

        def __enter__(self):
            return self

        def __exit__(self, *_):
            looking._held.clear()

        def map(self, of, parts):
            return map(of, parts)

    monkeypatch.setattr(looking, "ProcessPoolExecutor", Pool)
    tasks = [("box", k) for k in range(40)]
    parts = list(looking.results("held", tasks, 2, found))
    assert [len(part) for part in parts] == [16, 16, 8]
    assert [row for part in parts for row in part] == [("box", (k,), "held", True) for k in range(40)]


# Words and files


def in_words(**more):
    fields = {
        "header": {"names": ("a", "b"), "radius": 0.25},
        "lower": np.array([-1.0, 2.0]),
        "upper": np.array([1.0, 2.0]),
        "centre": np.zeros((3, 1)),
        "unglued": np.zeros((2, 2)),
        "shares": {"certified": 0.5, "empty": 0.125},
        "dependent": np.array([1, 2, 3]),
        **more,
    }
    return ClaimedDocument(**(blank(ClaimedDocument) | fields))


def test_what_is_claimed_in_words():
    assert wording.claimed(in_words()) == (
        "over a from -1 to 1, b = 2: 50 % certified, 12.5 % empty; σ is one function but for 2 faces on 3 boxes; "
        "the square of half width 0.25 about the seed is certified"
    )
    limits = np.array([[-MAX, MAX], [-MAX, 0.5], [-2.0, MAX]])
    told = wording.claimed(in_words(ranges=StatedRanges(None, None, None, limits), lower=np.array([0.75, 2.0])))
    assert told.startswith(
        "over a from 0.75 to 1, b = 2 and of configurations with coordinate 2 from −∞ to 0.5, "
        "coordinate 3 from -2 to ∞: "
    )
    large = np.array([[-0.7 * MAX, MAX], [-MAX, 0.7 * MAX], [-MAX, MAX]])
    told = wording.claimed(in_words(ranges=StatedRanges(None, None, None, large)))
    assert "coordinate 1 from -1.25839e+308 to ∞, coordinate 2 from −∞ to 1.25839e+308: " in told
    free = np.tile([-MAX, MAX], (3, 1))
    assert "configurations with" not in wording.claimed(in_words(ranges=StatedRanges(None, None, None, free)))


def test_what_is_not_looked_at_in_words(monkeypatch):
    monkeypatch.setattr(wording, "BallClosures", lambda document: None)
    monkeypatch.setattr(wording, "listed_share", lambda closures, document: 0.125)
    document = Curves(**blank(Curves) | {"uncovered_lower": np.zeros((4, 2))})
    assert "the 4 boxes hold that the document leaves uncovered (12.5 % at most" in wording.besides(document)


def test_numbers_of_a_file_are_finite(tmp_path):
    """One that is not among many that are; a folder is no file, and no file is not one either."""
    path = tmp_path / "numbers.npz"
    header = np.frombuffer(json.dumps({"a": 1}).encode(), dtype=np.uint8)
    for wrong in (np.inf, -np.inf, np.nan):
        np.savez(path, header=header, x=np.array([1.0, wrong, 2.0]))
        with pytest.raises(InvalidInputError, match="x holds numbers that are not finite"):
            container.contents(path)
    np.savez(path, header=header, x=np.array([1.0, MAX, 2.0]))
    assert container.contents(path)[1]["x"].tolist() == [1.0, MAX, 2.0]
    with pytest.raises(InvalidInputError, match="no regular file"):
        container.contents(tmp_path)
    with pytest.raises(InvalidInputError, match="not a readable certificate"):
        container.contents(tmp_path / "none.npz")

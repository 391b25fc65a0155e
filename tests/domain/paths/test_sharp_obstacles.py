"""Where demands are proved to fail: which condition fails, at which place, and how well that is known."""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.domain.paths import obstacles as module
from ccpin.errors import SingularConfigurationError
from ccpin.proof.newton import Boxes
from ccpin.proof.verdict import Witness

SYSTEM = SimpleNamespace(
    independent=np.array([0]), dependent=np.array([1]), n=1, m=1, n_free=2, periodic=np.zeros(2, bool)
)
PROBLEM = SimpleNamespace(system=SYSTEM)


# Lines


@pytest.mark.parametrize("fails", [None, 0.3, 1.0])
def test_lines_end_at_their_targets(monkeypatch, fails):
    """They go from where one is, part of the way first; what is found on one is told, and no more of that line."""

    class Asked(SimpleNamespace):
        def _replace(self, **changed):
            return Asked(**{**vars(self), **changed})

    problem = Asked(requirements="asked")
    reading = Asked(problem=problem, system=SimpleNamespace(independent=np.array([1, 2])))
    theta, targets, ends = np.array([9.0, 1.0, -1.0]), [np.array([3.0, -1.0]), np.array([1.0, 4.0])], []

    def walked(problem, theta, end):
        assert problem.requirements is None
        ends.append(end)
        return SimpleNamespace(times=[0.0, 1.0], here=1.0, end=end)

    def failing(reading, asked, walker):
        target = targets[0] if walker.end[0] > 1.0 else targets[1]
        share = float((walker.end - theta[1:]) @ (target - theta[1:]) / ((target - theta[1:]) @ (target - theta[1:])))
        return Witness("limit", walker.end, None, 0.0) if fails and share >= fails - 1e-9 else None

    monkeypatch.setattr(module, "_walked", walked)
    monkeypatch.setattr(module, "_failing", failing)
    found = list(module.demand_witnesses(reading, theta, targets))
    assert len(found) == (0 if fails is None else 2)
    for target in targets:
        along = target - theta[1:]
        shares = [
            (end - theta[1:]) @ along / (along @ along) for end in ends if np.sign(end[0] - 1) == np.sign(along[0])
        ]
        assert all(0.0 < share <= 1.0 for share in shares)
        assert shares == sorted(shares)
        assert shares[-1] == (1.0 if fails != 0.3 else shares[0])


@pytest.mark.parametrize("starts", [True, False])
def test_a_line_is_walked_from_where_one_is(monkeypatch, starts):
    asked = []

    def walker(problem, pieces, tube, theta):
        if not starts:
            raise SingularConfigurationError("", q_free=theta, rcond=0.0)
        asked.append((pieces(0.0).tolist(), pieces(1.0).tolist(), pieces.x.tolist(), tube.tolist()))
        return SimpleNamespace(walk=asked.append)

    monkeypatch.setattr(module, "Walker", walker)
    problem = SimpleNamespace(system=SimpleNamespace(independent=np.array([1, 2])))
    assert (module._walked(problem, np.array([9.0, 1.0, -1.0]), np.array([3.0, 4.0])) is not None) == starts
    assert not starts or asked[0] == ([1.0, -1.0], [3.0, 4.0], [0.0, 1.0], [0.0, 0.0])


# What fails at a place


def failure(monkeypatch, low=(0.0, 0.0), high=(0.0, 0.0), conditioned=2.0, signs=(1.0, 1.0), driven=1):
    """What is proved to fail between bounds of θ, an upper bound of 1/κ, and signs of det at the start and here."""
    asked = SimpleNamespace(
        lower=np.array([-4.0, -2.0]), upper=np.array([1.0, 3.0]), driven=np.arange(driven), dexterity=0.5
    )
    monkeypatch.setattr(module, "reach", lambda problem, box: (np.array([low]), np.array([high])))
    monkeypatch.setattr(module, "conditioning", lambda problem, asked, box: (np.array([0.0]), np.array([conditioned])))
    monkeypatch.setattr(module, "_sign", lambda reading, asked, place: signs[1])
    reading = SimpleNamespace(problem=None)
    return module._failure(reading, asked, SimpleNamespace(box=None), signs[0])


@pytest.mark.parametrize(
    ("told", "kind"),
    [
        ({}, None), ({"low": (0, 0), "high": (9, 9)}, None), ({"low": (-9, -9)}, None),
        ({"low": (1.001, 0), "high": (2, 0)}, "limit"), ({"low": (0.999, 0), "high": (2, 0)}, None),
        ({"low": (0, 3.001), "high": (0, 4)}, "limit"), ({"low": (0, 2.9), "high": (0, 4)}, None),
        ({"low": (-9, 0), "high": (-4.001, 0)}, "limit"), ({"low": (-9, 0), "high": (-3.999, 0)}, None),
        ({"low": (0, -9), "high": (0, -2.001)}, "limit"), ({"low": (0, -9), "high": (0, -1.999)}, None),
        ({"low": (0.6, 0), "high": (0.6, 0)}, None), ({"low": (-3, 0), "high": (-3, 0)}, None),
        ({"conditioned": 0.499}, "dexterity"), ({"conditioned": 0.501}, None), ({"conditioned": 0.9}, None),
        ({"signs": (1.0, -1.0)}, "singular"), ({"signs": (-1.0, 1.0)}, "singular"), ({"signs": (-1.0, -1.0)}, None),
        ({"signs": (0.0, -1.0)}, None), ({"signs": (1.0, 0.0)}, None),
        ({"signs": (1.0, -1.0), "conditioned": 0.0, "driven": 0}, None),
    ],
)  # fmt: skip
def test_what_fails(monkeypatch, told, kind):
    """A limit passed by more than is uncertain; too little dexterity; a determinant of the other sign."""
    assert failure(monkeypatch, **told) == kind


def failing(monkeypatch, kind, place_from, signs, driven=1, here=1.0, places=True):
    """The witness where a demand fails from a parameter on; q is twice the parameter, known to 1/8 and 1/4."""
    asked_signs = []
    times = np.linspace(0.0, here, 21)
    walker = SimpleNamespace(times=times, here=here, pieces=lambda at: np.array([2.0 * at, -at]))

    def place(problem, walker, at):
        if places is not True and at not in places:
            return None
        centre = np.array([[at]])
        return SimpleNamespace(at=at, q=np.array([2.0 * at, -at]), box=SimpleNamespace(centre=centre))

    def sign(reading, asked, place):
        asked_signs.append(place.at)
        return signs(place.at)

    monkeypatch.setattr(module, "_place", place)
    monkeypatch.setattr(module, "_sign", sign)
    monkeypatch.setattr(module, "reach", lambda problem, box: (np.array([[0.5, 1.0]]), np.array([[0.625, 1.25]])))
    monkeypatch.setattr(
        module, "_failure", lambda reading, asked, place, sign: kind if place.at >= place_from else None
    )
    reading = SimpleNamespace(problem=None, configuration=lambda theta: theta)
    found = module._failing(reading, SimpleNamespace(driven=np.arange(driven)), walker)
    assert driven or not asked_signs
    return found


def test_the_first_place_that_fails(monkeypatch):
    """To 2⁻¹² of the way; its error is how wide the configuration's bounds are."""
    found = failing(monkeypatch, "limit", 0.3, lambda at: 1.0)
    assert (found.kind, found.error) == ("limit", 0.25)
    assert 0.3 <= found.q_free[0] <= 0.3 + 2.0**-12
    np.testing.assert_array_equal(found.q, [2 * found.q_free[0], -found.q_free[0]])
    assert failing(monkeypatch, "limit", 2.0, lambda at: 1.0) is None
    assert failing(monkeypatch, "limit", 0.0, lambda at: 1.0, places=()) is None
    assert failing(monkeypatch, "limit", 0.3, None, driven=0).kind == "limit"
    some = failing(monkeypatch, "limit", 0.3, lambda at: 1.0, places=(1.0, 0.5))
    assert some.q_free[0] == 0.5


def test_where_a_walk_ended_early_some_steps_before_its_end_count(monkeypatch):
    found = failing(monkeypatch, "limit", 0.0, lambda at: 1.0, here=0.5, places=(0.2,))
    assert found.q_free[0] == pytest.approx(0.2)  # 12 of 20 boxes back
    assert failing(monkeypatch, "limit", 0.0, lambda at: 1.0, here=0.5, places=(0.5,)) is None


@pytest.mark.parametrize("start", [1.0, -1.0])
def test_a_singular_place_is_known_from_where_the_sign_was_proved(monkeypatch, start):
    """Between the last place at which it is the start's and this one; from the start where that is not proved."""
    found = failing(monkeypatch, "singular", 0.3, lambda at: start)
    assert found.error == pytest.approx(0.25 + 2 * 2.0**-12, abs=1e-12)
    for unproved in (0.0, -start):
        found = failing(monkeypatch, "singular", 0.3, lambda at, other=unproved: start if at == 0.0 else other)
        assert found.error == pytest.approx(0.25 + found.q[0], abs=1e-12)
    nowhere = failing(monkeypatch, "singular", 0.3, lambda at: start, places=(0.0, 1.0))
    assert nowhere.error == pytest.approx(0.25 + 2.0, abs=1e-12)


# Where a walker is


def placed(monkeypatch, at, still=True, point=True, held=(True, True)):
    """The place of a walker with three boxes over [0, 1]; its box, and the δ asked for."""
    asked = []
    one = np.ones((3, 1, 1))
    directions = np.zeros((3, 2, 2))
    boxes = Boxes(np.arange(6.0).reshape(3, 2), one[:, 0], directions, one, one, one[:, 0], one[:, 0], one[:, 0, 0])
    walker = SimpleNamespace(times=[0.0, 0.25, 0.5, 1.0], boxes=boxes)

    def solve(problem, box, delta):
        asked.append((int(box.centre[0, 0]) // 2, delta.tolist()))
        return SimpleNamespace(theta=np.array([[7.0, 8.0]]))

    def encloses(problem, box, delta, *ball):
        return np.array([held[0] if box is not tried.boxes else held[1]])

    tried = SimpleNamespace(proved=np.array([still]), boxes="still")
    exact = SimpleNamespace(proved=np.array([point]), boxes=boxes.take(np.array([0])))
    monkeypatch.setattr(module, "solve_in_boxes", solve)
    monkeypatch.setattr(module, "certify_boxes", lambda *_: tried)
    monkeypatch.setattr(module, "certify_points", lambda *_: exact)
    monkeypatch.setattr(module, "encloses", encloses)
    return module._place(PROBLEM, walker, at), asked[0]


@pytest.mark.parametrize(
    ("at", "box", "along"),
    [
        (0.0, 0, -1.0), (0.0625, 0, -0.5), (0.25, 1, -1.0), (0.375, 1, 0.0), (0.5, 2, -1.0), (0.875, 2, 0.5),
        (1.0, 2, 1.0),
    ],
)  # fmt: skip
def test_a_walkers_place_is_in_the_box_it_walked_in(monkeypatch, at, box, along):
    place, asked = placed(monkeypatch, at)
    assert asked == (box, [[along, 0.0]])
    assert (place.q.tolist(), place.box) == ([7.0], "still")


@pytest.mark.parametrize("told", [{"still": False}, {"point": False}, {"held": (False, True)}, {"held": (True, False)}])
def test_a_place_is_proved_to_be_the_branchs(monkeypatch, told):
    """By a box of no width there, and one point's box that lies in that and in the walker's."""
    assert placed(monkeypatch, 0.375, **told)[0] is None


# Signs


def sign(monkeypatch, regular=True, more=0, rods=()):
    """Of φ_θ by what is not driven: of a carriage neither the rows nor the columns; rods are no joints."""
    monkeypatch.setattr(module, "regular", lambda problem, asked, box: np.array([regular]))
    slope = np.array([[[5.0, 1.0, 2.0, 0.0], [6.0, 3.0, 4.0, 0.0], [2.0, 7.0, 8.0, -1.0]]])
    monkeypatch.setattr(module, "closure_values", lambda problem, theta: (None, slope))
    weights = np.zeros((2, 3, 3))
    weights[0, :2, 0] = 1.0
    weights[1, 2, 1] = 1.0
    chains = [SimpleNamespace(joints=np.array([0, 1, 2]), weights=weights[0])]
    chains.append(SimpleNamespace(joints=np.array([3, 1]), weights=weights[1]))
    system = SimpleNamespace(n_free=4, m=3, independent=np.array([3]), chains=chains)
    places = [SimpleNamespace(place=slice(*place)) for place in rods]
    reading = SimpleNamespace(system=system, chart=SimpleNamespace(n_free=4 - more), rods=places, problem=None)
    driven = np.array([0]) if more or rods else np.array([3])
    return module._sign(reading, SimpleNamespace(driven=driven), SimpleNamespace(box=SimpleNamespace(centre=None)))


def test_signs_of_determinants(monkeypatch):
    assert sign(monkeypatch, more=1) == -1.0  # 1·4 − 2·3
    whole = np.linalg.det([[5.0, 1.0, 2.0], [6.0, 3.0, 4.0], [2.0, 7.0, 8.0]])
    assert sign(monkeypatch) == np.sign(whole)
    assert sign(monkeypatch, regular=False) == 0.0
    rodded = np.linalg.det([[1.0, 2.0, 0.0], [3.0, 4.0, 0.0], [7.0, 8.0, -1.0]])
    assert sign(monkeypatch, more=1, rods=[(2, 3)]) == np.sign(rodded) == 1.0
    assert sign(monkeypatch, more=2, rods=[(2, 3)]) == -1.0

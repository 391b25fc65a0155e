"""The tracking bound's numbers as its theorem writes them, and just where it holds and does not."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.control import ComputedTorque, PDOnlineGravity, PDPlus
from ccpin.control.stability.tracking import (
    deviation,
    on_line,
    reference_tube,
    tracking_error,
    tube_levels,
    tube_search,
)
from ccpin.control.stability.tracking.cell_forms import CellForms
from ccpin.control.stability.tracking.deviation import Deviation
from ccpin.control.stability.tracking.error_equations import Feedback, equation_of
from ccpin.control.stability.tracking.on_line import _speed, _worst, online_demand
from ccpin.control.stability.tracking.tube_levels import Disturbances, Levels, _reached, levels_of
from ccpin.control.stability.tracking.tube_search import FoundTube, TubeSearch
from ccpin.control.tracking import TrackingLaw
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.proof.balls import Affine, affine
from ccpin.proof.facts import NotProvedError


def form(mid, rad=0.0, lin=None, boxed=0):
    mid = np.asarray(mid, float)
    lin = np.zeros((0, *mid.shape)) if lin is None else np.asarray(lin, float)
    return Affine(mid, lin, rad * np.ones_like(mid), boxed)


# Deviations.


def sized(slope, push=None, sigma_error=0.5, disturbance=(0.0, 0.0), scale=(1.0, 1.0)):
    push = np.zeros((len(slope.mid), 2, 2)) if push is None else np.asarray(push, float)
    one = Deviation(slope, push, None, None, None)
    return one.size(sigma_error, np.array(disturbance), np.array(scale))


def test_the_size_of_deviations():
    """ε‖L⁻¹G‖₂ of the middle is attained; boxed parameters count whole, δ's half, radii by their Frobenius norm."""
    G = np.array([[3.0, 0.0, 1.0], [0.0, -4.0, 2.0]])
    scale = np.array([0.5, 2.0])
    exact = 0.5 * np.linalg.norm(G / scale[:, None], 2)
    assert sized(form(G[None]), scale=scale)[0] == pytest.approx(exact, rel=1e-9)
    lin = np.zeros((4, 1, 2, 3))
    lin[0, 0, 0, 0], lin[1, 0, 1, 1], lin[2, 0, 0, 2], lin[3, 0, 1, 0] = 1.0, 2.0, 3.0, 4.0
    found = sized(form(np.zeros((1, 2, 3)), lin=lin, boxed=2))[0]
    assert found == pytest.approx(0.5 * (1.0 + 2.0 + 0.5 * 5.0), rel=1e-9)
    found = sized(form(np.zeros((1, 2, 3)), rad=1.0))[0]
    assert found == pytest.approx(0.5 * np.sqrt(6.0), rel=1e-9)
    push = [[[1.0, 2.0], [0.5, 0.0]]]
    found = sized(form(np.zeros((1, 2, 3))), push, disturbance=(2.0, 3.0), scale=scale)[0]
    assert found == pytest.approx(np.hypot(8.0 / 0.5, 1.0 / 2.0), rel=1e-9)
    both = sized(form(G[None]), push, disturbance=(2.0, 3.0), scale=scale)[0]
    assert both == pytest.approx(exact + found, rel=1e-9)


def test_deviations_that_are_not_known_are_no_numbers():
    """In one entry of one cell; the others' sizes are told."""
    G = np.ones((2, 2, 3))
    G[1, 0, 0] = np.nan
    found = sized(form(G))
    assert np.isfinite(found[0])
    assert np.isnan(found[1])


def states(seed=0, count=2, n=2, width=3):
    rng = np.random.default_rng(seed)
    made = [form(rng.normal(size=(count, width)), lin=rng.normal(size=(2, count, width)), boxed=2)]
    made += [form(rng.normal(size=(count, n)), 0.01, rng.normal(size=(2, count, n)), 2) for _ in range(5)]
    return CellForms(*made)


def test_what_a_law_computes_of():
    """Computed torque: q̇, q̇ and q̈_d + K_v ė + K_p e; PD+: q̇, q̇_d and q̈_d."""
    at = states()
    K_p, K_v = np.array([[4.0, 1.0], [1.0, 3.0]]), np.array([[2.0, 0.5], [0.5, 1.0]])
    found = equation_of("computed_torque").motion(Feedback("computed_torque", K_p, K_v), at)
    for part in ("mid", "lin"):
        e, e_dot, a_d = (getattr(x, part) for x in (at.e, at.e_dot, at.a_d))
        np.testing.assert_allclose(getattr(found[2], part), a_d + e @ K_p + e_dot @ K_v, rtol=1e-12)
    least = 0.01 * (1.0 + np.abs(K_p).sum(axis=1) + np.abs(K_v).sum(axis=1))
    np.testing.assert_allclose(found[2].rad, np.tile(least, (2, 1)), rtol=1e-9)
    assert found[0] is found[1] is at.v
    assert equation_of("pd_plus").motion(Feedback("pd_plus", K_p, K_v), at)[:3] == (at.v, at.v_d, at.a_d)
    for kind in ("pd", "pd_gravity", None):
        with pytest.raises(NotProvedError):
            equation_of(kind)


def test_cells_are_bounded_chunk_by_chunk(monkeypatch):
    """All of them, in their order."""
    asked = []

    def part(equations, chunk, sigma_error):
        asked.append(len(chunk.e.mid))
        return Deviation(chunk.e[:, :, None], chunk.e.mid, *[chunk.e[:, :, None]] * 3)

    monkeypatch.setattr(deviation, "_part", part)
    at = states(count=7)
    system = SimpleNamespace(m=2)
    loops = [SimpleNamespace(joints=np.zeros((1000, 4)))]
    equations = SimpleNamespace(masses=SimpleNamespace(loops=loops), closures=SimpleNamespace(system=system))
    found = deviation.deviation_of(equations, at, 0.1)
    assert sum(asked) == 7
    np.testing.assert_array_equal(found.push, at.e.mid)


# σ found on line.


@pytest.fixture
def demand(monkeypatch):
    def run(slope, sigma_error=1e-3, period=1e-2, speeds=(1.0, 2.0), stretch=4.0):
        starts, count = [], len(speeds)
        told = iter(speeds)
        monkeypatch.setattr(on_line, "_TOGETHER", 3)
        cells, seen = states(count=6 if count == 2 else 3), []
        monkeypatch.setattr(on_line, "_speed", lambda _, chunk: seen.append(chunk.e.mid) or next(told))
        slopes = iter([0.5 * slope, slope][:count])
        stretches = iter([stretch, 0.5 * stretch][:count])
        monkeypatch.setattr(
            on_line, "_newton", lambda _, __, start: starts.append(start) or (next(slopes), next(stretches))
        )
        found = online_demand(None, cells, sigma_error, period)
        np.testing.assert_array_equal(np.concatenate(seen), cells.e.mid)
        return found, starts

    return run


def test_newton_steps_that_suffice(demand):
    """E₀ = ε + period · speed, each step leaves ½Le², until ε: by hand."""
    found, starts = demand(20.0)
    assert starts == [pytest.approx(0.021)] * 2
    assert found.start == pytest.approx(0.021)
    first = 0.5 * 20.0 * 0.021**2
    assert first == pytest.approx(0.00441)
    assert 0.5 * 20.0 * first**2 < 1e-3 < first
    assert found.steps == 2
    assert found.tolerance == pytest.approx(1e-3 / 4.0)
    edge = 2 * 1e-3 / 0.021**2
    assert demand(0.999 * edge)[0].steps == 1
    assert demand(1.001 * edge)[0].steps == 2
    assert demand(20.0, period=1e-12)[0].steps == 1


@pytest.mark.parametrize(("share", "holds"), [(0.99, True), (1.01, False)])
def test_newton_contracts_or_nothing_is_told(demand, share, holds):
    """½Le₀ < 1."""
    slope = 2.0 * share / 0.021
    if holds:
        assert demand(slope)[0].steps > 2
    else:
        with pytest.raises(NotProvedError):
            demand(slope)
    with pytest.raises(NotProvedError):
        demand(np.inf)
    with pytest.raises(NotProvedError):  # E₀ = 1.5 ε
        demand(2.02 / 1.5e-3, period=0.25e-3)


def test_speeds_of_the_dependent_coordinates(monkeypatch):
    """The largest ‖dy/dt‖₂: of ρ v at its ends."""
    rho = form([[[1.0, 2.0], [3.0, -4.0], [0.0, 1.0]], np.ones((3, 2))])
    monkeypatch.setattr(on_line, "Reduced", lambda *_: SimpleNamespace(rho=rho))
    system = SimpleNamespace(dependent=np.array([0, 1]))
    equations = SimpleNamespace(closures=SimpleNamespace(system=system), masses=None)
    at = SimpleNamespace(theta=None, v=form([[1.0, -1.0], [0.5, 0.25]]))
    assert _speed(equations, at) == pytest.approx(np.hypot(1.0, 7.0), rel=1e-9)
    assert _worst(np.array([1.0, 3.0, 2.0])) == 3.0
    assert _worst(np.array([1.0, np.nan])) == np.inf


def test_newtons_constants(monkeypatch):
    """L = ‖φ_y⁻¹φ_yy‖ and ‖M⁻¹r‖ for |r| ≤ 1, of the dependent coordinates; φ_yy at another place than φ_y."""
    bend = np.arange(1.0, 1.0 + 2 * 3 * 3).reshape(1, 2, 3, 3)
    lin = np.zeros((1, 1, 2, 3, 3))
    lin[0, 0, 0, 1, 1] = 0.5
    solved = []

    def solve(right):
        solved.append(right)
        return (
            form(2.0 * right.mid, lin=2.0 * right.lin)
            if not right.rad.any()
            else Affine(2.0 * right.mid, right.lin, 2.0 * right.rad)
        )

    at = SimpleNamespace(bend=Affine(bend, lin, np.zeros_like(bend), 1), grip=SimpleNamespace(solve=solve))
    monkeypatch.setattr(on_line, "Reduced", lambda *_: at)
    system = SimpleNamespace(m=2, dependent=np.array([1, 2]))
    equations, asked = SimpleNamespace(closures=SimpleNamespace(system=system), masses=None), []
    cells = SimpleNamespace(thickened=lambda *given: asked.append(given) or SimpleNamespace(theta=None))
    slope, stretch = on_line._newton(equations, cells, 0.1)
    assert asked == [(system, 0.1)]
    parts = bend[0][:, 1:, 1:].copy()
    parts[0, 0, 0] += 0.5
    assert slope == pytest.approx(2.0 * np.sqrt(np.sum(parts**2)), rel=1e-9)
    assert stretch == pytest.approx(2.0 * np.sqrt(2.0), rel=1e-9)
    assert len(solved[0].lin) == 0


# The search.


def test_levels_follow_their_equation():
    """v̇ = −α(v − w_k), v^½ raised by a kick; the larger of both ends; at last the limit."""
    sources, kicks, durations = np.array([1.0, 4.0, 2.0]), np.array([9.0, 0.5, 0.0]), np.array([0.5, 0.25, 1.0])
    reached, ends = _reached(3.0, sources, kicks, 2.0, durations)
    first = 1.0 + 2.0 * np.exp(-1.0)
    second = (np.sqrt(first) + 0.5) ** 2
    later = 4.0 + (second - 4.0) * np.exp(-0.5)
    np.testing.assert_allclose(reached, [3.0, max(second, later), max(later, 2.0)], rtol=1e-9)
    np.testing.assert_allclose(ends, [first, later, 2.0], rtol=1e-9)
    assert np.all(reached >= [3.0, max(second, later), max(later, 2.0)])
    falling, _ = _reached(9.0, np.array([1.0, 1.0]), np.zeros(2), 1.0, np.ones(2))
    assert falling[1] == pytest.approx(1.0 + 8.0 * np.exp(-1.0), rel=1e-9)


@pytest.fixture
def searched(monkeypatch):
    """A search over two cells of one coordinate, whose levels are told; what the kernel says of it: all is proved."""

    def run(levels, proved=(True, True), middles=(True, True), refused=()):
        asked, claims, told, refusing = [], [], iter(range(99)), iter(refused)

        def boxes(room):
            asked.append(room)
            return f"boxes {len(asked)}", np.array(proved if len(asked) > 1 else middles)

        def prove(claim, *premises):
            claims.append((claim, premises))
            if next(refusing, False):
                raise NotProvedError("so it is")
            return SimpleNamespace(found={"bound": np.array([[0.25, 0.5], [2.0, 9.0]])})

        cells = SimpleNamespace(times=np.array([0.0, 1.0, 2.0]), place=SimpleNamespace(start=np.array([[0.5], [1.0]])))
        tube = SimpleNamespace(
            path=SimpleNamespace(verdict="proven", reason="path", proved="path's"), centre=np.zeros((2, 3)),
            cells=cells, boxes=boxes, proved=lambda boxes: (boxes, "glue"),
            equations=SimpleNamespace(closures=SimpleNamespace(system=None), feedback="feedback"),
        )  # fmt: skip
        monkeypatch.setattr(tube_search, "forms_of", lambda *_: SimpleNamespace(middles=lambda: None))
        monkeypatch.setattr(tube_search, "deviation_of", lambda *_: None)
        monkeypatch.setattr(tube_search, "TubeKept", SimpleNamespace)
        monkeypatch.setattr(tube_search, "prove", prove)
        monkeypatch.setattr(
            tube_search, "levels_of", lambda *given: levels(next(told), given[5] if len(given) > 5 else None)
        )
        one = TubeSearch(tube, Disturbances(0.5, np.zeros(1), np.zeros(2)))
        one._choice = lambda middle: SimpleNamespace(decay=3.0, cross=0.25, scale=np.ones(1), P=None)
        return one, asked, claims

    return run


def level(
    reached=(1.0, 2.0),
    allowed=(9.0, 9.0),
    widths=((0.5, 0.25), (1.0, 2.0)),
    entries=((0.0, 0.0), (0.1, 0.1)),
    sources=(1.0, 4.0),
):
    return Levels(*(np.array(x, float) for x in (reached, allowed, widths, entries, sources)), 0.75)


def test_what_a_level_says():
    """|x| ≤ (P⁻¹)^½ v^½; rooms hold that and what enters."""
    one = level(entries=((3.0, 0.0), (0.1, 7.0)))
    np.testing.assert_allclose(one.bound, np.sqrt([[1.0], [2.0]]) * [[0.5, 0.25], [1.0, 2.0]], rtol=1e-9)
    np.testing.assert_allclose(one.needed, [[3.0, 0.25], [np.sqrt(2.0), 7.0]], rtol=1e-9)


@pytest.mark.parametrize("cell", [0, 1])
@pytest.mark.parametrize(("share", "holds"), [(1.0 - 1.05e-6, True), (1.0 - 0.95e-6, False), (1.5, False)])
def test_levels_are_below_what_is_allowed(cell, share, holds):
    """V < c_k on each cell."""
    reached = np.array([1.0, 1.0])
    reached[cell] = 9.0 * share
    assert level(reached=reached).held(np.ones((2, 2))) is holds


@pytest.mark.parametrize("place", [(0, 0), (1, 0), (1, 1)])
@pytest.mark.parametrize(("share", "holds"), [(1.0 - 1.05e-6, True), (1.0 - 0.95e-6, False), (1.5, False)])
def test_cells_are_entered_inside(place, share, holds):
    """|x| at the beginning of a cell is below its room."""
    entries, room = np.zeros((2, 2)), np.array([[0.5, 0.25], [2.0, 3.0]])
    entries[place] = share * room[place]
    assert level(entries=entries).held(room) is holds


@pytest.mark.parametrize(
    "wrong",
    [
        {"widths": ((0.5, np.inf), (1.0, 2.0))}, {"widths": ((np.nan, 1.0), (1.0, 2.0))}, {"sources": (1.0, np.inf)},
        {"sources": (np.nan, 1.0)}, {"reached": (np.nan, 1.0)}, {"entries": ((0.0, 0.0), (0.0, np.nan))},
    ],
)  # fmt: skip
def test_what_is_not_known_is_not_held(wrong):
    assert not level(**wrong).held(np.full((2, 2), 10.0))


def test_what_is_found_is_proved(searched):
    """At once, without levels, where it holds: the claim has the room tried, the choice and what was given."""
    one, asked, claims = searched(lambda k, room: level() if room is None else None)
    found = one.found()
    assert found.proved is not None
    assert "below 2 " in found.reason
    (claim, premises) = claims[0]
    assert premises == ("path's", "boxes 2", "glue")
    np.testing.assert_array_equal(asked[0], np.zeros((2, 1)))
    np.testing.assert_array_equal(claim.room[:, :1], asked[1])
    np.testing.assert_array_equal(claim.times, one.tube.cells.times)
    assert (claim.decay, claim.cross, claim.sigma_error) == (3.0, 0.25, 0.5)
    assert claim.storage.shape == (0, 0)
    assert (claim.disturbance, claim.start) == (one.given.push, one.given.start)


def test_what_is_refused_is_said(searched):
    """A bound that the kernel does not find is none; one that it refuses at first is grown until it holds."""
    found = searched(lambda k, room: level(), refused=[True, True])[0].found()
    assert found.proved is None
    assert "did not hold" in found.reason
    assert "so it is" in found.reason
    reached = iter([1.0, 10.0, 1.0])
    one, asked, claims = searched(lambda k, room: level(reached=[next(reached)] * 2), refused=[True])
    assert one.found().proved is not None
    assert (one.rounds, len(asked), len(claims)) == (2, 3, 2)


def test_rooms_grow_to_what_is_needed(searched):
    """From the middles' bound on; every round as large as what came out, and more."""
    entries = np.array([[5.0, 0.0], [0.0, 7.0]])
    one, asked, _ = searched(
        lambda k, room: level(reached=(10.0, 10.0), allowed=(9.0, 9.0), entries=entries), refused=[True]
    )
    assert one.found().proved is None
    needed = np.maximum(np.sqrt(10.0) * np.array([[0.5, 0.25], [1.0, 2.0]]), entries)[:, :1]
    assert all(np.all(room > needed) for room in asked[1:])
    assert all(np.all(later >= before) for before, later in pairwise(asked[1:]))


@pytest.mark.parametrize("which", [(False, True), (True, False)])
def test_sigma_is_to_be_proved_on_every_cell(searched, which):
    assert "σ is not proved" in searched(lambda k, room: level(), proved=which)[0].found().reason
    assert "σ is not proved" in searched(lambda k, room: level(), middles=which)[0].found().reason


def test_what_is_open_is_told(searched):
    """One infinite width, one cell without a level, one without a number; a path that is open; no plan."""
    for wrong, said in (
        ({"widths": ((0.5, np.inf), (1.0, 2.0))}, "D is not proved"),
        ({"widths": ((0.5, 1.0), (np.nan, 2.0))}, "D is not proved"),
        ({"sources": (1.0, np.inf)}, "V̇ is not proved"),
        ({"sources": (np.nan, 1.0)}, "φ_y"),
    ):
        found = searched(lambda k, room, w=wrong: level() if room is None else level(**w), refused=[True])[0].found()
        assert (found.proved, said in found.reason) == (None, True)
    one = searched(lambda k, room: level())[0]
    one.tube.path.verdict = "undecided"
    assert "reference itself" in one.found().reason
    one = searched(lambda k, room: level())[0]
    one._choice = lambda middle: None
    assert "no storage" in one.found().reason


def test_levels_by_the_theorem(monkeypatch):
    """W_k = g²Δ², v(0) ≥ V(x(0)) after a jump, J ≥ (κᵀPκ)^½, c_k = min X²/(P⁻¹)_ii, and |x| where cells begin."""
    P = np.array([[[2.0, 0.5], [0.5, 1.0]], [[3.0, -1.0], [-1.0, 4.0]], [[1.0, 0.0], [0.0, 1.0]]])
    kicks = np.array([[0.1, 0.2], [0.3, 0.0], [0.0, 0.4]])
    width, g = np.array([[0.5, 1.0], [0.25, 0.5], [1.0, 2.0]]), np.array([1.0, 2.0, 3.0])
    size = np.array([0.5, 0.25, 0.125])
    monkeypatch.setattr(tube_levels, "storage_of", lambda *_: SimpleNamespace(P=affine(P)))
    monkeypatch.setattr(tube_levels, "gain", lambda *_: g)
    monkeypatch.setattr(tube_levels, "widths", lambda _: width)
    cells = SimpleNamespace(kicks=kicks, times=np.array([0.0, 0.5, 0.75, 1.75]))
    start, choice = np.array([0.25, 0.5]), SimpleNamespace(decay=2.0, scale=None)
    given = Disturbances(0.1, np.zeros(1), start)
    dev = SimpleNamespace(D=None, C=None, damping=None, size=lambda *_: size)
    room = np.array([[1.0, 3.0], [2.0, 1.0], [4.0, 5.0]])
    found = levels_of(None, choice, dev, given, cells, room)
    first = start + kicks[0]
    np.testing.assert_allclose(found.sources, (g * size) ** 2, rtol=1e-9)
    assert found.start == pytest.approx(first @ P[0] @ first, rel=1e-9)
    np.testing.assert_allclose(found.allowed, ((room / width) ** 2).min(axis=1))
    np.testing.assert_array_equal(levels_of(None, choice, dev, given, cells).allowed, [np.inf] * 3)
    jumps = np.sqrt([k @ np.abs(p) @ k for k, p in zip(kicks, P, strict=True)])
    reached, ends = _reached(found.start, found.sources, jumps, 2.0, np.diff(cells.times))
    np.testing.assert_allclose(found.reached, reached, rtol=1e-8)
    entries = np.vstack([first, np.sqrt(ends[:2, None]) * width[:2] + kicks[1:]])
    np.testing.assert_allclose(found.entries, entries, rtol=1e-8)
    assert np.all(found.entries[1:] >= entries[1:])


# What is told of it.


def test_what_a_search_finds_is_certified(monkeypatch):
    """With what dry friction leaves of it."""
    given = Disturbances(0.1, np.zeros(2), np.zeros(4))
    monkeypatch.setattr(
        tracking_error, "TubeSearch", lambda *asked: SimpleNamespace(found=lambda: FoundTube(asked, "so"))
    )
    monkeypatch.setattr(tracking_error, "without_dry_friction", lambda _: ", but")
    law = SimpleNamespace(model=SimpleNamespace(mechanism=None))
    made = tracking_error._certificate(law, "tube", given)
    assert (made.law, made.sigma_error, made.disturbance) == (law, 0.1, given.push)
    assert (made.proved, made.told, made._tube) == (("tube", given), "so, but", "tube")


def test_bounds_that_are_given():
    np.testing.assert_array_equal(tracking_error.bound_at_start(0.5, "x", 2), [0.5, 0.5])
    np.testing.assert_array_equal(tracking_error.bound_at_start([0.5, 0.0], "x", 2), [0.5, 0.0])
    for bad in (-0.1, [0.1, -0.1], np.inf, [np.nan, 0.0], [0.1] * 3):
        with pytest.raises(InvalidInputError):
            tracking_error.bound_at_start(bad, "x", 2)


@pytest.mark.parametrize(
    "wrong",
    [
        {"scalar": False}, {"constant": False}, {"actuated": ("a", "c")}, {"actuated": ("a",)},
        {"law": TrackingLaw}, {"law": PDOnlineGravity},
    ],
)  # fmt: skip
def test_what_the_theorem_is_about(monkeypatch, wrong):
    """Scalar coordinates that stay, and motors on them, in any order."""
    kinds = {ComputedTorque: "computed_torque", PDPlus: "pd_plus", PDOnlineGravity: "pd_gravity"}
    monkeypatch.setattr(reference_tube, "kind_of", lambda law: kinds.get(type(law)))
    coordinates = SimpleNamespace(scalar=wrong.get("scalar", True), constant=wrong.get("constant", True))
    mechanism = SimpleNamespace(name="m", independent=("a", "b"), actuated=wrong.get("actuated", ("b", "a")))
    model = SimpleNamespace(mechanism=mechanism, coordinates=coordinates)
    kind = wrong.get("law", ComputedTorque)
    made = object.__new__(type("Other", (kind,), {"_force": lambda *_: None}) if kind is TrackingLaw else kind)
    vars(made).update(model=model, K_p=None, K_v=None)
    with pytest.raises(UnsupportedMechanismError):
        tracking_error._check(made)
    for kind in (ComputedTorque, PDPlus):
        fine = object.__new__(kind)
        plain = SimpleNamespace(scalar=True, constant=True)
        mechanism = SimpleNamespace(independent=("a", "b"), actuated=("b", "a"))
        model = SimpleNamespace(mechanism=mechanism, coordinates=plain)
        vars(fine).update(model=model, K_p=None, K_v=None)
        tracking_error._check(fine)

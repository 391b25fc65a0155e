"""The tracking bound's numbers as its theorem writes them, and just where it holds and does not."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.control import ComputedTorque, PDOnlineGravity, PDPlus
from ccpin.control.stability.tracking import deviation, error_equations, on_line, tracking_error, tube_search
from ccpin.control.stability.tracking.deviation import Deviation, thickened
from ccpin.control.stability.tracking.error_equations import equation_of
from ccpin.control.stability.tracking.on_line import _speed, _worst, online_demand
from ccpin.control.stability.tracking.reference_tube import CellForms
from ccpin.control.stability.tracking.tube_search import Levels, TubeSearch, _reached
from ccpin.control.tracking import TrackingLaw
from ccpin.errors import ConvergenceError, InvalidInputError, UnsupportedMechanismError
from ccpin.proof.balls import Affine, affine


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


def test_what_a_law_computes_of(monkeypatch):
    """Computed torque: q̇, q̇ and q̈_d + K_v ė + K_p e; PD+: q̇, q̇_d and q̈_d."""
    at = states()
    K_p, K_v = np.array([[4.0, 1.0], [1.0, 3.0]]), np.array([[2.0, 0.5], [0.5, 1.0]])
    monkeypatch.setattr(error_equations, "kind_of", lambda law: law.kind)
    law = SimpleNamespace(K_p=K_p, K_v=K_v, kind="computed_torque")
    found = equation_of(law).motion(law, at)
    for part in ("mid", "lin"):
        e, e_dot, a_d = (getattr(x, part) for x in (at.e, at.e_dot, at.a_d))
        np.testing.assert_allclose(getattr(found[2], part), a_d + e @ K_p + e_dot @ K_v, rtol=1e-12)
    least = 0.01 * (1.0 + np.abs(K_p).sum(axis=1) + np.abs(K_v).sum(axis=1))
    np.testing.assert_allclose(found[2].rad, np.tile(least, (2, 1)), rtol=1e-9)
    assert found[0] is found[1] is at.v
    plus = SimpleNamespace(kind="pd_plus")
    assert equation_of(plus).motion(plus, at)[:3] == (at.v, at.v_d, at.a_d)


def test_cells_thickened_by_errors_of_sigma():
    """δ moves each dependent coordinate by ε and nothing else, with parameters of its own."""
    at = states(width=4)
    tube = SimpleNamespace(problem=SimpleNamespace(system=SimpleNamespace(m=2, dependent=np.array([1, 3]))))
    found = thickened(tube, at, 0.25)
    for wide, thin in zip(found, at, strict=True):
        assert wide.lin.shape[0] == 4
        np.testing.assert_array_equal(wide.lin[:2], thin.lin)
        np.testing.assert_array_equal(wide.mid, thin.mid)
        assert wide.boxed == 2
    expected = np.zeros((2, 2, 4))
    expected[0, :, 1] = expected[1, :, 3] = 0.25
    np.testing.assert_array_equal(found.theta.lin[2:], expected)
    assert all(not wide.lin[2:].any() for wide in found[1:])


def test_cells_are_bounded_chunk_by_chunk(monkeypatch):
    """All of them, in their order."""
    asked = []

    def part(law, tube, chunk, sigma_error):
        asked.append(len(chunk.e.mid))
        return Deviation(chunk.e[:, :, None], chunk.e.mid, *[chunk.e[:, :, None]] * 3)

    monkeypatch.setattr(deviation, "_part", part)
    at = states(count=7)
    system = SimpleNamespace(m=2)
    loops = [SimpleNamespace(joints=np.zeros((1000, 4)))]
    tube = SimpleNamespace(masses=SimpleNamespace(loops=loops), problem=SimpleNamespace(system=system))
    found = deviation.deviation_of(None, tube, at, 0.1)
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
        with pytest.raises(ConvergenceError):
            demand(slope)
    with pytest.raises(ConvergenceError):
        demand(np.inf)
    with pytest.raises(ConvergenceError):  # E₀ = 1.5 ε
        demand(2.02 / 1.5e-3, period=0.25e-3)


def test_speeds_of_the_dependent_coordinates(monkeypatch):
    """The largest ‖dy/dt‖₂: of ρ v at its ends."""
    rho = form([[[1.0, 2.0], [3.0, -4.0], [0.0, 1.0]], np.ones((3, 2))])
    monkeypatch.setattr(on_line, "Reduced", lambda *_: SimpleNamespace(rho=rho))
    system = SimpleNamespace(dependent=np.array([0, 1]))
    tube = SimpleNamespace(problem=SimpleNamespace(system=system), masses=None)
    at = SimpleNamespace(theta=None, v=form([[1.0, -1.0], [0.5, 0.25]]))
    assert _speed(tube, at) == pytest.approx(np.hypot(1.0, 7.0), rel=1e-9)
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
    monkeypatch.setattr(on_line, "thickened", lambda *_: SimpleNamespace(theta=None))
    tube = SimpleNamespace(
        problem=SimpleNamespace(system=SimpleNamespace(m=2, dependent=np.array([1, 2]))), masses=None
    )
    slope, stretch = on_line._newton(tube, None, 0.1)
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


def searched(levels, proved=(True, True), middles=None, rounds=None):
    """A search over two cells of one coordinate, whose levels are told."""
    asked = []

    def of(room, speed_room):
        asked.append(np.concatenate([room, speed_room], axis=1))
        ok = np.array(proved if len(asked) > 1 else (True, True) if middles is None else middles)
        return SimpleNamespace(middles=lambda: None), ok

    motion = (SimpleNamespace(start=np.array([[0.5], [1.0]])),)
    tube = SimpleNamespace(
        path=SimpleNamespace(verdict="proven", reason="path"), motion=motion, states=of, times=np.array([0.0, 1.0, 2.0])
    )
    one = TubeSearch(SimpleNamespace(), tube, 0.5, np.zeros(1), np.zeros(2))
    one._planned = lambda middle: SimpleNamespace(decay=3.0)
    told = iter(range(99))
    one._levels = lambda dev, room=None: levels(next(told), room)
    return one, asked


@pytest.fixture(autouse=True)
def _no_deviations(monkeypatch):
    monkeypatch.setattr(tube_search, "deviation_of", lambda *_: None)


def level(
    reached=(1.0, 2.0),
    allowed=(9.0, 9.0),
    widths=((0.5, 0.25), (1.0, 2.0)),
    entries=((0.0, 0.0), (0.1, 0.1)),
    sources=(1.0, 4.0),
):
    return Levels(*(np.array(x, float) for x in (reached, allowed, widths, entries, sources)), 0.75)


def test_what_is_proved_is_told():
    """|x| ≤ (P⁻¹)^½ v^½; the last cell's w as t → ∞; γ = max w^½/ε."""
    one, asked = searched(lambda k, room: level())
    found = one.found()
    assert found.verdict == "proven"
    np.testing.assert_allclose(found.bound, np.sqrt([[1.0], [2.0]]) * [[0.5, 0.25], [1.0, 2.0]], rtol=1e-9)
    np.testing.assert_allclose(found.ultimate, [2.0], rtol=1e-9)
    assert found.gain == pytest.approx(2.0 / 0.5)
    assert (found.decay, found.start) == (3.0, 0.75)
    np.testing.assert_array_equal(found.unit, [1.0, 2.0])
    np.testing.assert_array_equal(found.room, asked[-1])
    np.testing.assert_array_equal(asked[0], np.zeros((2, 2)))
    assert f"{np.sqrt(2.0):.3g}" in found.reason


@pytest.mark.parametrize("cell", [0, 1])
@pytest.mark.parametrize(("share", "holds"), [(1.0 - 1.05e-6, True), (1.0 - 0.95e-6, False), (1.5, False)])
def test_levels_are_below_what_is_allowed(cell, share, holds):
    """V < c_k on each cell."""
    reached = np.array([1.0, 1.0])
    reached[cell] = 9.0 * share
    one, _ = searched(lambda k, room: level(reached=reached))
    assert (one.found().verdict == "proven") is holds


@pytest.mark.parametrize("place", [(0, 0), (1, 0), (1, 1)])
@pytest.mark.parametrize(("share", "holds"), [(1.0 - 1.05e-6, True), (1.0 - 0.95e-6, False), (1.5, False)])
def test_cells_are_entered_inside(place, share, holds):
    """|x| at the beginning of a cell is below its room."""

    def told(k, room):
        entries = np.zeros((2, 2))
        if room is not None:
            entries[place] = share * room[place]
        return level(entries=entries)

    assert (searched(told)[0].found().verdict == "proven") is holds


def test_rooms_grow_to_what_is_needed():
    """From the middles' bound on; every round as large as what came out, and more."""
    entries = np.array([[5.0, 0.0], [0.0, 7.0]])

    def told(k, room):
        return level(reached=(10.0, 10.0), allowed=(9.0, 9.0), entries=entries)

    one, asked = searched(told)
    assert one.found().verdict == "undecided"
    needed = np.maximum(np.sqrt(10.0) * np.array([[0.5, 0.25], [1.0, 2.0]]), entries)
    assert all(np.all(room > needed) for room in asked[1:])
    assert all(np.all(later >= before) for before, later in pairwise(asked[1:]))


@pytest.mark.parametrize("which", [(False, True), (True, False)])
def test_sigma_is_to_be_proved_on_every_cell(which):
    assert "σ is not proved" in searched(lambda k, room: level(), proved=which)[0].found().reason
    assert "σ is not proved" in searched(lambda k, room: level(), middles=which)[0].found().reason


def test_what_is_open_is_told():
    """One infinite width, one cell without a level, one without a number; a path that is open; no plan."""
    for wrong, said in (
        ({"widths": ((0.5, np.inf), (1.0, 2.0))}, "D is not proved"),
        ({"widths": ((0.5, 1.0), (np.nan, 2.0))}, "D is not proved"),
        ({"sources": (1.0, np.inf)}, "V̇ is not proved"),
        ({"sources": (np.nan, 1.0)}, "φ_y"),
    ):
        found = searched(lambda k, room, w=wrong: level() if room is None else level(**w))[0].found()
        assert found.room.shape == (2, 2)
        assert (found.verdict, said in found.reason) == ("undecided", True)
        assert np.all(np.isinf(found.bound))
        assert found.bound.shape == (2, 2)
        assert found.ultimate.shape == (1,)
    one, _ = searched(lambda k, room: level())
    one.tube.path.verdict = "undecided"
    assert "reference itself" in one.found().reason
    one, _ = searched(lambda k, room: level())
    one._planned = lambda middle: None
    assert "no storage" in one.found().reason


def test_levels_by_the_theorem(monkeypatch):
    """W_k = g²Δ², v(0) ≥ V(x(0)) after a jump, J ≥ (κᵀPκ)^½, c_k = min X²/(P⁻¹)_ii, and |x| where cells begin."""
    P = np.array([[[2.0, 0.5], [0.5, 1.0]], [[3.0, -1.0], [-1.0, 4.0]], [[1.0, 0.0], [0.0, 1.0]]])
    kicks = np.array([[0.1, 0.2], [0.3, 0.0], [0.0, 0.4]])
    width, g = np.array([[0.5, 1.0], [0.25, 0.5], [1.0, 2.0]]), np.array([1.0, 2.0, 3.0])
    size = np.array([0.5, 0.25, 0.125])
    monkeypatch.setattr(tube_search, "storage_of", lambda *_: SimpleNamespace(P=affine(P)))
    monkeypatch.setattr(tube_search, "gain", lambda *_: g)
    monkeypatch.setattr(tube_search, "widths", lambda _: width)
    tube = SimpleNamespace(kicks=kicks, times=np.array([0.0, 0.5, 0.75, 1.75]))
    start = np.array([0.25, 0.5])
    one = TubeSearch(None, tube, 0.1, np.zeros(1), start)
    one.plan = SimpleNamespace(decay=2.0, scale=None)
    dev = SimpleNamespace(D=None, C=None, damping=None, size=lambda *_: size)
    room = np.array([[1.0, 3.0], [2.0, 1.0], [4.0, 5.0]])
    found = one._levels(dev, room)
    first = start + kicks[0]
    np.testing.assert_allclose(found.sources, (g * size) ** 2, rtol=1e-9)
    assert found.start == pytest.approx(first @ P[0] @ first, rel=1e-9)
    np.testing.assert_allclose(found.allowed, ((room / width) ** 2).min(axis=1))
    np.testing.assert_array_equal(one._levels(dev).allowed, [np.inf] * 3)
    jumps = np.sqrt([k @ np.abs(p) @ k for k, p in zip(kicks, P, strict=True)])
    reached, ends = _reached(found.start, found.sources, jumps, 2.0, np.diff(tube.times))
    np.testing.assert_allclose(found.reached, reached, rtol=1e-8)
    entries = np.vstack([first, np.sqrt(ends[:2, None]) * width[:2] + kicks[1:]])
    np.testing.assert_allclose(found.entries, entries, rtol=1e-8)
    assert np.all(found.entries[1:] >= entries[1:])


# What is told of it.


def test_errors_and_speeds_of_a_certificate(monkeypatch):
    bound = np.array([[1.0, 2.0, 3.0, 4.0], [2.0, 1.0, 5.0, 0.5]])
    found = tube_search.TubeBounds("proven", "so", bound, np.array([0.1, 0.2]), 3.0, 2.0, np.ones(4), 0.5, bound)
    monkeypatch.setattr(tracking_error, "TubeSearch", lambda *_: SimpleNamespace(found=lambda: found))
    monkeypatch.setattr(tracking_error, "without_dry_friction", lambda _: ", but")
    law = SimpleNamespace(model=SimpleNamespace(mechanism=None))
    made = tracking_error._certificate(
        law, SimpleNamespace(times=np.array([0.0, 1.0, 2.0])), 0.1, np.zeros(2), np.zeros(4)
    )
    np.testing.assert_array_equal(made.errors, bound[:, :2])
    np.testing.assert_array_equal(made.speeds, bound[:, 2:])
    np.testing.assert_array_equal(made.error, [2.0, 2.0])
    np.testing.assert_array_equal(made.times, [0.0, 1.0, np.inf])
    assert made.reason == "so, but"


def test_bounds_that_are_given():
    np.testing.assert_array_equal(tracking_error._bound(0.5, "x", 2), [0.5, 0.5])
    np.testing.assert_array_equal(tracking_error._bound([0.5, 0.0], "x", 2), [0.5, 0.0])
    for bad in (-0.1, [0.1, -0.1], np.inf, [np.nan, 0.0], [0.1] * 3):
        with pytest.raises(InvalidInputError):
            tracking_error._bound(bad, "x", 2)


@pytest.mark.parametrize(
    "wrong", [{"scalar": False}, {"constant": False}, {"actuation": 1}, {"law": TrackingLaw}, {"law": PDOnlineGravity}]
)
def test_what_the_theorem_is_about(monkeypatch, wrong):
    """Scalar coordinates that stay, and motors on them."""
    kinds = {ComputedTorque: "computed_torque", PDPlus: "pd_plus", PDOnlineGravity: "pd_gravity"}
    monkeypatch.setattr(error_equations, "kind_of", lambda law: kinds.get(type(law)))
    coordinates = SimpleNamespace(scalar=wrong.get("scalar", True), constant=wrong.get("constant", True))
    model = SimpleNamespace(
        mechanism=SimpleNamespace(name="m"), coordinates=coordinates, actuation=wrong.get("actuation")
    )
    kind = wrong.get("law", ComputedTorque)
    made = object.__new__(type("Other", (kind,), {"_force": lambda *_: None}) if kind is TrackingLaw else kind)
    object.__setattr__(made, "model", model)
    with pytest.raises(UnsupportedMechanismError):
        tracking_error._check(made)
    for kind in (ComputedTorque, PDPlus):
        fine = object.__new__(kind)
        plain = SimpleNamespace(scalar=True, constant=True)
        object.__setattr__(fine, "model", SimpleNamespace(mechanism=None, coordinates=plain, actuation=None))
        tracking_error._check(fine)

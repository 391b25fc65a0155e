"""The whole paper recomputed: every item within its bound, comparisons that can fail, and the page in a browser."""

import json

import numpy as np
import pytest

from ccpin import paper
from ccpin.cli import main
from ccpin.errors import InvalidInputError
from ccpin.paper import control as control_items
from ccpin.paper import modeling, printed, reduced, robot, study
from ccpin.paper import omega as domain_items
from ccpin.paper.reproduction import COUNT, Reproduction
from tests.oracles import rpdr as oracle
from tests.support.browser import click, opened

NUMBERS = (
    *("Eq. (2)", "Eq. (3)", "Eq. (7)", "Eqs. (9), (10)", "Eqs. (11), (12), Lemma II.1", "Eq. (13)", "Eq. (14)"),
    *("Eq. (35)", "Eq. (17)", "Eq. (18)", "Eq. (19)", "Eq. (22), Theorem 1", "Eq. (23)", "Eq. (24)", "Eq. (25)"),
    *("Eq. (27)", "Lemma III.1", "Figs. 1–5", "Table II", "Eq. (31)", "Eq. (33)", "Eq. (36)", "Eq. (37)", "Eq. (38)"),
    *("Eqs. (39), (40)", "det ψ_q′", "Theorem 2, example", "Table I", "Fig. 6", "Fig. 7", "Region 𝒟", "Eq. (28)"),
    *("Eq. (30)", "𝒱", "d𝒱/dt", "Theorem 3", "Fig. 8", "Fig. 9", "Fig. 10"),
)


@pytest.fixture(scope="module")
def found():
    """The reproduction, one cycle of Experiment 2 instead of two, and the items it told of."""
    told = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "CYCLES", 1)
        yield paper.reproduce(told.append), told


@pytest.mark.slow
def test_every_item_is_within_its_bound(found):
    """Every numbered item agrees with the paper; each bound has a reason, each is told of once."""
    whole, told = found
    assert [(item.number, item.difference) for item in whole.items if not item.agrees] == []
    assert whole.agrees
    assert tuple(item.number for item in whole.items) == NUMBERS
    assert tuple(told) == whole.items
    assert len(whole.items) == COUNT
    assert all(item.reason and item.compared and item.paper and item.ours for item in whole.items)


@pytest.mark.slow
def test_bounds_are_not_generous(found):
    """Identities are held to rounding or to their difference quotients; the rest to printed digits or to nothing."""
    printed_digits = {"Fig. 6": 5e-4, "Fig. 8": 5e-3, "Fig. 9": 0.05}
    for item in found[0].items:
        assert item.bound <= printed_digits.get(item.number, 1e-5), item.number


def test_the_printed_side_is_the_oracles():
    """What the page holds ccpin against is what the tests hold it against, written twice."""
    random = np.random.default_rng(4)
    for mode in (1, -1):
        for q in oracle.random_configurations(random, 20, mode):
            v = random.normal(size=4)
            assert np.allclose(printed.phi(q), oracle.phi(q), rtol=0, atol=1e-15)
            assert np.allclose(printed.psi_jacobian(q), oracle.psi_jacobian(q), rtol=0, atol=1e-15)
            assert np.allclose(printed.rho(q), oracle.rho(q), rtol=0, atol=1e-11)
            assert np.allclose(printed.mass_matrix(q), oracle.mass_matrix(q), rtol=0, atol=1e-15)
            assert np.allclose(printed.coriolis_matrix(q, v), oracle.coriolis_matrix(q, v), rtol=0, atol=1e-15)
            assert np.allclose(printed.gravity(q), oracle.gravity(q), rtol=0, atol=1e-14)
            apart = printed.sigma(q[:2], mode) - oracle.sigma(q[:2], mode)
            assert np.allclose(np.sin(apart / 2), 0.0, rtol=0, atol=1e-12)
    slope = [(printed.potential(q + h) - printed.potential(q - h)) / 2e-6 for h in 1e-6 * np.eye(4)]
    assert np.allclose(slope, printed.gravity(q), rtol=0, atol=1e-8)
    assert np.allclose(printed.coincident_elbows(), oracle.coincident_elbows())


@pytest.mark.parametrize(
    ("name", "changed", "chapter", "number"),
    [
        ("phi", lambda f: lambda q: f(q) + 1e-6, robot, "Eq. (31)"),
        ("psi_jacobian", lambda f: lambda q: f(q) * (1 + 1e-9), robot, "Eq. (33)"),
        ("psi_jacobian", lambda f: lambda q: f(q)[:, [0, 1, 3, 2]], modeling, "Eq. (14)"),
        ("mass_matrix", lambda f: lambda q: f(q) + 1e-9, reduced, "Eq. (19)"),
        ("mass_matrix", lambda f: lambda q: f(q) + 1e-8, robot, "Eq. (36)"),
        ("coriolis_matrix", lambda f: lambda q, v: f(q, v).T, robot, "Eq. (37)"),
        ("coriolis_matrix", lambda f: lambda q, v: 0.5 * f(q, v), reduced, "Eq. (24)"),
        ("gravity", lambda f: lambda q: f(q) * 9.8 / 9.81, robot, "Eq. (38)"),
        ("potential", lambda f: lambda q: 1.001 * f(q), control_items, "𝒱"),
        ("sigma", lambda f: lambda q, mode=1: f(q, mode) + [0, 0, 1e-8, 0], robot, "Eqs. (39), (40)"),
    ],
)
def test_a_difference_would_be_seen(monkeypatch, name, changed, chapter, number):
    """An item stops agreeing when the printed side is changed, by as little as its bound allows to see."""
    case = paper.Study()
    monkeypatch.setattr(printed, name, changed(getattr(printed, name)))
    item = next(item for item in chapter.items(case) if item.number == number)
    assert not item.agrees


def test_table_one_is_the_tables_of_the_paper():
    """The radii by their rows: exact ones by the closed form, none above, the closest form where it was found."""
    rows = paper.Study().radii
    assert [row.exact for row in rows] == pytest.approx([15.056, 3.467, 40.737, 13.056], abs=1e-3)
    assert [row.closest for row in rows] == pytest.approx([4.31, 1.13, 1.59, 0.86], abs=5e-3)
    for row in rows:
        assert max(row.paper, row.closest, row.theorem2, row.reach, row.planar) <= row.exact
        assert 0.999 * row.exact <= row.atlas <= row.exact


def test_the_worked_example_would_fail_with_another_c(monkeypatch):
    """v is compared entry by entry."""
    monkeypatch.setattr(domain_items, "EXAMPLE_V", np.array([2.0, 2.0, 4.0, 1.0, 2.0, 8.0]))
    assert not next(domain_items.items(paper.Study())).agrees


@pytest.mark.slow
def test_the_errata_rest_on_numbers(found):
    """Each by the number its evidence rests on, from elsewhere."""
    by_place = {}
    for erratum in found[0].errata:
        by_place.setdefault(erratum.place, []).append(erratum)
    assert by_place["det ψ_q′"][0].value == pytest.approx(0.3048 * 0.3048, rel=1e-12)
    assert by_place["(39), (40)"][0].value > 0.1
    short = 2 * 0.3048 * (oracle.elongation(np.radians([-108.0, 72.0])) - 1.0)
    assert by_place["Table I"][0].value == pytest.approx(short, rel=1e-9)
    assert by_place["Theorem 3, Experiment 1"][0].value == pytest.approx(13.099, abs=1e-3)
    assert by_place["Experiment 2"][0].value == pytest.approx(0.452, abs=2e-3)


@pytest.mark.slow
def test_theorem_three_and_what_closes_the_gap(found):
    """The paper's start is outside of B₂, and the enclosure of its motion ends inside."""
    facts = dict(next(item for item in found[0].items if item.number == "Theorem 3").facts)
    assert facts["verdict about the goal"] == "proven"
    assert "outside of B₂" in facts["𝒱 at the paper's start"]
    pytest.importorskip("flint")
    assert facts["the paper's start by validated integration"].startswith("proven")


@pytest.mark.slow
def test_the_page(found, tmp_path):
    """Every item with its three tabs, every figure loaded, nothing asked of the network, nothing on the console."""
    whole = found[0]
    path = paper.write(whole, tmp_path / "deep" / "paper.html")
    drawings = sum(len(item.drawings) for item in whole.items)
    with opened(path.as_uri(), 1200, 900) as browser:
        assert browser.evaluate("document.querySelectorAll('article').length") == len(whole.items)
        ids = browser.evaluate("[...document.querySelectorAll('[id]')].map(x => x.id)")
        assert len(ids) == len(set(ids))
        targets = browser.evaluate("[...document.querySelectorAll('a[href^=\"#\"]')].map(x => x.getAttribute('href'))")
        assert {target[1:] for target in targets} <= set(ids)
        loaded = "Promise.all([...document.images].map(x => x.decode().then(() => x.naturalWidth > 0)))"
        assert browser.evaluate(loaded) == [True] * drawings
        panels = "[...document.querySelectorAll('#fig-6 .panel')].map(x => x.offsetParent !== null)"
        assert browser.evaluate(panels) == [False, True, False]
        browser.evaluate("document.documentElement.style.scrollBehavior = 'auto'")
        browser.evaluate("document.querySelector('#fig-6').scrollIntoView()")
        click(browser, "#fig-6 label:nth-of-type(3)")
        assert browser.evaluate(panels) == [False, False, True]
        asked = browser.evaluate("performance.getEntriesByType('resource').map(x => x.name)")
        assert [name for name in asked if not name.startswith("data:")] == []


@pytest.mark.slow
def test_the_command(found, tmp_path, monkeypatch, capsys):
    """A page and a table, or JSON without a bare NaN; the exit code tells whether all agrees."""
    whole = found[0]
    monkeypatch.setattr(paper, "reproduce", lambda progress: whole)
    assert main(["paper", "-o", str(tmp_path / "paper.html")]) == 0
    assert f"{len(NUMBERS)} of {len(NUMBERS)} items agree" in capsys.readouterr().out
    assert (tmp_path / "paper.html").stat().st_size > 100_000
    assert main(["paper", "--json"]) == 0
    told = json.loads(capsys.readouterr().out, parse_constant=lambda word: pytest.fail(word))
    assert [item["number"] for item in told["items"]] == list(NUMBERS)
    first = whole.items[0]._replace(difference=1.0)
    broken = whole._replace(chapters=(("broken", (first,)), *whole.chapters[1:]))
    monkeypatch.setattr(paper, "reproduce", lambda progress: broken)
    assert main(["paper"]) == 4
    assert "NOT within" in capsys.readouterr().out


def test_a_page_that_cannot_be_written_is_told_before_it_is_computed(tmp_path, monkeypatch, capsys):
    """A folder where the page should go."""
    monkeypatch.setattr(paper, "reproduce", lambda progress: pytest.fail("computed"))
    assert main(["paper", "-o", str(tmp_path)]) == 1
    assert "it is a folder" in capsys.readouterr().err
    with pytest.raises(InvalidInputError, match="folder"):
        paper.write(Reproduction((), (), (), 0.0, ""), tmp_path)


def test_ctrl_c_is_not_swallowed(monkeypatch):
    """A motion that ends at Ctrl-C with what it has is no result of the paper's."""
    case = paper.Study()
    stopped = case.ideal._replace(status="interrupted")
    monkeypatch.setattr(study, "simulate", lambda *_, **__: stopped)
    with pytest.raises(KeyboardInterrupt):
        _ = paper.Study().ideal

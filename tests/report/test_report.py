"""Reports: one page about any mechanism, whole or with the reason why a part is missing."""

import json
import re

import numpy as np
import pytest

import ccpin
from ccpin import report
from ccpin.cli import main
from ccpin.errors import InvalidInputError
from ccpin.report import set_point_move, validity
from ccpin.report.page import PARTS
from tests.support.browser import opened
from tests.support.places import SHARED

QUICK = report.ReportSettings(modes_budget=0.5, depth=3, grid=5, duration=0.3)


def written(mechanism, folder, settings=QUICK):
    """The report's text and what `write` says of it."""
    done = report.write(ccpin.load(mechanism), folder / "report.html", settings)
    return (folder / "report.html").read_text(encoding="utf-8"), done


@pytest.fixture(scope="module")
def slider(tmp_path_factory):
    """The page of a move that was asked for, and what `write` says of it."""
    settings = QUICK._replace(start=np.radians([20.0]), goal=np.radians([40.0]))
    return written("slider_crank", tmp_path_factory.mktemp("report"), settings)


@pytest.fixture(scope="module")
def five_bar(tmp_path_factory):
    """The same of two coordinates, finer."""
    start, goal = np.radians([-150.0, -160.0]), np.radians([-90.0, -100.0])
    settings = QUICK._replace(depth=4, start=start, goal=goal, duration=0.5)
    return written("rpdr", tmp_path_factory.mktemp("report"), settings)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        pytest.param(
            "rpdr",
            ["2 independent motions", "certified boxes", "Singular curves", "assembly mode"],
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "four_bar", ["one independent motion", "boxes, edges halved up to 3 times"], marks=pytest.mark.slow
        ),
        ("slider_crank", ["one independent motion", "boxes, edges halved up to 3 times"]),
        pytest.param("delta", ["3 independent motions", "Slices through the reference"], marks=pytest.mark.slow),
        pytest.param(
            "stewart", ["6 independent motions", "Slices through the reference", "not proved"], marks=pytest.mark.slow
        ),
        pytest.param("bennett", ["one independent motion"], marks=pytest.mark.slow),
    ],
)
def test_reports_of_the_zoo(name, words, tmp_path, request):
    """What each mechanism's page says; no part is missing, and every address is in the file."""
    kept = {"rpdr": "five_bar", "slider_crank": "slider"}
    page, done = request.getfixturevalue(kept[name]) if name in kept else written(name, tmp_path)
    assert done.failed == {}
    assert set(done.seconds) == set(PARTS)
    for word in ("What it is", "Where the model holds", "An experiment", "To repeat this page", *words):
        assert word in page or word in _titles(page), word
    outside = re.sub(r'srcdoc="[^"]*"', "", page)
    assert re.findall(r'(?:src|href)="(?!data:|#)[^"]*"', outside) == []


@pytest.mark.slow
def test_an_atlas_shares_sum_to_the_whole(five_bar):
    """What the page says of each kind of cell, singular ones included."""
    page, _ = five_bar
    shares = {kind: float(share) for share, kind in re.findall(r"([\d.]+) % (\w+)", page)}
    assert set(shares) >= {"certified", "empty", "singular", "undecided", "unreached"}
    assert shares["singular"] > 0.0
    assert sum(shares.values()) == pytest.approx(100.0, abs=0.03)


def _titles(page):
    """Words that are in figures only are looked for in captions; the atlas's are drawn."""
    return "certified boxes" if "The atlas; + is the reference." in page else ""


@pytest.mark.slow
def test_a_page_in_a_browser(tmp_path):
    """The animation within plays, every figure loads, nothing is asked of the network, the console is clean."""
    _, done = written("stewart", tmp_path)
    with opened(done.path.as_uri(), 1200, 900) as browser:
        loaded = "Promise.all([...document.images].map(x => x.decode().then(() => x.naturalWidth > 0)))"
        assert all(browser.evaluate(loaded))
        browser.evaluate("document.querySelector('iframe').scrollIntoView()")
        inner = "document.querySelector('iframe').contentDocument"
        look = f"const look = () => {inner}?.querySelector('canvas')?.width > 100 ? done(1) : setTimeout(look, 50)"
        assert browser.evaluate(f"new Promise(done => {{ {look}; look(); }})") == 1
        asked = "[...performance.getEntriesByType('resource'), ...document.querySelector('iframe').contentWindow"
        names = browser.evaluate(asked + ".performance.getEntriesByType('resource')].map(x => x.name)")
        assert [name for name in names if not name.startswith(("data:", "blob:", "about:"))] == []


def test_the_experiment_asked_for(slider):
    """Start, goal and duration are the experiment's, and are printed to repeat it."""
    page, _ = slider
    assert "20.00°" in page
    assert "40.00°" in page
    assert "<code>duration</code>: <code>0.3</code>" in page


def test_a_goal_that_cannot_be_reached_is_an_error(tmp_path):
    """What was asked for is not replaced by something else, and no page is written."""
    with pytest.raises(ccpin.CcpinError):
        written("rpdr", tmp_path, QUICK._replace(goal=np.radians([-108.0, 72.0])))
    with pytest.raises(InvalidInputError):
        written("rpdr", tmp_path, QUICK._replace(start=[1.0, 2.0, 3.0]))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_with_too_few_motors_it_is_released(tmp_path):
    """No set-point law, and the reason; the motion is a free one."""
    mechanism = ccpin.load("rpdr", actuated=["joint1"])
    found = set_point_move.run(ccpin.ReducedModel(mechanism), QUICK)
    assert found.goal is None
    assert "Released at rest" in found.words
    assert found.motion.status == "finished"
    done = report.write(mechanism, tmp_path / "page.html", QUICK)
    assert done.failed == {}


def test_the_goal_beside_the_start_is_on_the_branch():
    """σ leads there, well conditioned, within the joints' limits."""
    for name in ("rpdr", "slider_crank", "delta", "stewart", "hexa"):
        mechanism = ccpin.load(name)
        model = ccpin.ReducedModel(mechanism)
        start = model.alpha(mechanism.q_reference)
        goal = set_point_move.beside(model, start)
        state = model.at(goal)
        low, high = mechanism.position_limits
        assert np.all((low <= state.q_free) & (state.q_free <= high)), name
        assert state.rcond > 0.2 * model.at(start).rcond, name
        assert np.abs(goal - start).max() > 1e-3, name


@pytest.mark.slow
def test_slices_are_the_conditioning_of_psi():
    """Every reached point has the 1/κ of σ there; the reference is the middle; beyond a singularity is nothing."""
    model = ccpin.ReducedModel(ccpin.load("delta"))
    x, y, values = validity.survey(model, (0, 2), 4)
    assert len(x) == len(y) == 5
    q0 = model.alpha(model.mechanism.q_reference)
    assert (x[2], y[2]) == pytest.approx((q0[0], q0[2]), abs=1e-12)
    for i in range(5):
        for j in range(5):
            if np.isfinite(values[i, j]):
                q = np.array([x[i], q0[1], y[j]])
                assert values[i, j] == pytest.approx(model.at(q).rcond, rel=1e-6)
    wide = ccpin.ReducedModel(ccpin.load("stewart"))
    assert np.isnan(validity.survey(wide, (0, 1), 9)[2]).any()


def test_the_command(tmp_path, capsys, monkeypatch):
    """A file and a line about it; JSON with the seconds of each part; an option that fails names itself."""
    page = tmp_path / "report.html"
    write, done = report.write, []
    monkeypatch.setattr(report, "write", lambda *given, **more: done.append(write(*given, **more)) or done[-1])
    assert main(["report", "slider_crank", "-o", str(page), "--depth", "3", "--duration", "0.2"]) == 0
    said = capsys.readouterr()
    assert f"wrote {page}" in said.out
    assert said.err == f"ccpin: writing {page} takes about ten seconds\n"
    with monkeypatch.context() as again:
        again.setattr(report, "write", lambda *_, **__: done[0])
        assert main(["report", "slider_crank", "-o", str(page), "--depth", "3", "--duration", "0.2", "--json"]) == 0
    said = capsys.readouterr()
    assert set(json.loads(said.out)["seconds"]) == set(PARTS)
    assert said.err == ""
    assert main(["report", "slider_crank", "-o", str(tmp_path)]) == 1
    assert "it is a folder" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cassie_closed_chain.xml", "mini_cheetah_leg.urdf"])
def test_a_file_of_somebody_elses(name, tmp_path):
    """Many coordinates, a floating base, continuous joints, an open chain: as the file is."""
    if not (SHARED / name).is_file():
        pytest.skip("other people's models are not beside the project")
    page, done = written(str(SHARED / name), tmp_path)
    assert "What it is" in page
    assert done.failed == {}


def test_nothing_moves(tmp_path):
    """A mechanism held still: the page says so where the motion would be, and is there for the rest."""
    done = report.write(ccpin.load("four_bar", locked=["crank"]), tmp_path / "page.html", QUICK)
    assert set(done.failed) == {"experiment"}
    assert "nothing moves" in (tmp_path / "page.html").read_text(encoding="utf-8")

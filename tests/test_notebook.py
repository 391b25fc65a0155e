"""What a notebook shows: tables, curves and maps that are sound HTML, and the scene in a frame of its own."""

import re
from html import unescape
from io import BytesIO
from xml.etree import ElementTree

import numpy as np
import pytest

import ccpin
from ccpin import displays, domain, plotting, visualization
from tests.support.browser import opened, settle

MECHANISM = ccpin.load("rpdr")
MODEL = ccpin.ReducedModel(MECHANISM)
Q = np.radians([-108.0, -72.0])


def shown(thing):
    """A display as a tree of elements: it must be well-formed."""
    return ElementTree.fromstring(f"<div>{thing._repr_html_()}</div>")


def cells(tree):
    """The rows of its table by name."""
    return {row.find("th").text: row.find("td").text for row in tree.iter("tr")}


@pytest.fixture(scope="module")
def motion():
    return ccpin.simulate(MODEL, None, Q, duration=0.1)


def test_a_mechanism_and_a_model_show_what_they_are():
    """Names, sizes, and D at the reference."""
    assert cells(shown(MECHANISM))["independent"] == "joint1 joint2"
    rows = cells(shown(MODEL))
    there = MODEL.at(MODEL.alpha(MECHANISM.q_reference))
    assert "n = 2 of n′ = 4" in rows["reduced model of"]
    assert rows["D at the reference"] == np.array2string(there.D, precision=4)


def test_a_trajectory_shows_its_curves(motion):
    """How it ended, and one line a coordinate and a motor, from the first sample to the last."""
    tree = shown(motion)
    assert motion.message in cells(tree)["motion"]
    lines = [line.get("points").split() for line in tree.iter("{http://www.w3.org/2000/svg}polyline")]
    assert len(lines) == 4
    assert all(line[0].startswith("0.0,") and line[-1].startswith("360.0,") for line in lines)


def test_a_figure_shows_itself(motion):
    """As a PNG, where it is a cell's value; of 100 dots an inch however fine a file of it would be."""
    from PIL import Image

    figure = plotting.plot_motion(motion, MECHANISM)
    shown = Image.open(BytesIO(figure._repr_png_()))
    np.testing.assert_allclose(shown.size, 100 * figure.get_size_inches(), atol=1)


def test_curves_keep_their_scale():
    """The least value is at the bottom, the largest at the top, whatever the number of samples."""
    x = np.linspace(0.0, 2.0, 5001)
    tree = ElementTree.fromstring(displays.curves(x, (x - 1.0)[:, None] ** 2, ["<b>"], height=100))
    points = [pair.split(",") for pair in tree.find(".//{*}polyline").get("points").split()]
    heights = np.array([float(y) for _, y in points])
    assert len(points) <= displays.POINTS + 20
    np.testing.assert_allclose([heights[0], heights[-1], heights.max()], [0.0, 0.0, 100.0], atol=0.1)
    assert "<b>" in "".join(tree.itertext())


def test_an_atlas_shows_a_map():
    """One rectangle a box, where the box is; for other than two coordinates a table alone."""
    atlas = domain.certify(MECHANISM, Q, (Q - 0.2, Q + 0.2))
    tree = shown(atlas)
    assert "100 % of the region" in cells(tree)["certified"]
    rectangles = [r for r in tree.iter("{http://www.w3.org/2000/svg}rect") if r.get("x")]
    assert len(rectangles) == len(atlas.lower)
    areas = sum(float(r.get("width")) * float(r.get("height")) for r in rectangles)
    boxes = np.prod(atlas.upper - atlas.lower, axis=1).sum() * (240 / 0.4) ** 2
    assert areas == pytest.approx(boxes, rel=1e-2)
    one = domain.certify(ccpin.load("four_bar"), [0.7], ([0.6], [0.8]))
    assert "<svg" not in one._repr_html_()


def test_a_scene_is_embedded_whole(motion):
    """The frame's page is the one `animate` writes, and needs nothing from outside."""
    embedded = visualization.embed(MECHANISM, motion.q_free, motion.t, trace="end_effector", height=300)
    frame = embedded._repr_html_()
    page = unescape(re.search(r'srcdoc="(.*?)" style', frame, re.S)[1])
    assert page == embedded.page
    assert "height: 300px" in frame
    assert not re.search(r'(src|href)="https?:', page)
    assert len(repr(embedded)) < 60


def test_a_live_viewer_is_framed():
    """By its own address."""
    with visualization.view(MECHANISM, open_browser=False) as viewer:
        assert f'src="{viewer.url}"' in viewer._repr_html_()


@pytest.mark.slow
def test_an_embedded_scene_draws_in_a_browser(tmp_path, motion):
    """Inside a page such as a notebook's, without errors in the console."""
    notebook = tmp_path / "notebook.html"
    frame = visualization.embed(MECHANISM, motion.q_free, motion.t)._repr_html_()
    notebook.write_text(f'<!doctype html><meta charset="utf-8"><body>{frame}</body>', encoding="utf-8")
    with opened(notebook.as_uri()) as page:
        settle(page, 500)
        drawn = "document.querySelector('iframe').contentDocument.querySelector('canvas') !== null"
        assert page.evaluate(drawn) is True


@pytest.mark.slow
def test_a_notebook_runs():
    """Executed by Jupyter's own machinery, each cell's value arrives as HTML."""
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    lines = ["import ccpin; m = ccpin.load('rpdr'); m", "ccpin.ReducedModel(m)", "ccpin.visualization.embed(m)"]
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(line) for line in lines])
    nbclient.NotebookClient(book, timeout=120).execute()
    assert all("text/html" in cell.outputs[0]["data"] for cell in book.cells)

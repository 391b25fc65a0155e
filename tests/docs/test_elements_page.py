"""The page of loop elements: each file there is shown, loads, and has the mobility and gearing its row states."""

import re

import numpy as np
import pytest

import ccpin
from ccpin.description import CLOSURE_KINDS
from ccpin.description.urdf.loop_elements import READERS
from tests.support.places import ROOT

FOLDER = ROOT / "docs" / "elements"
PAGE = (ROOT / "docs" / "elements.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| \[([\w./]+)\]\(elements/\1\) \| .* \| (\d) \| ([^|]*) \|$", PAGE, re.M)
KIND_ROWS = re.findall(r"^\| \[[\w.]+\]\(elements/[\w.]+\) \| (\w+) \| (\d) \| (\d) \|", PAGE, re.M)


@pytest.mark.parametrize(("name", "n", "turns"), ROWS, ids=[row[0] for row in ROWS])
def test_a_file_is_what_its_row_says(name, n, turns):
    """The mobility, and how far D turns for one radian of A: a parallelogram's 1, a gear's −2."""
    if name.startswith("xacro"):
        pytest.importorskip("xacrodoc")
    mechanism = ccpin.load(FOLDER / name)
    assert mechanism.n == int(n)
    if re.fullmatch(r"−?\d", turns.strip()):
        model = ccpin.ReducedModel(mechanism)
        rho = model.at(model.alpha(mechanism.q_reference)).rho[:, 0]
        rates = {joint.name: rho[joint.v.start] for joint in mechanism.tree.joints}
        assert np.isclose(rates["D"] / rates["A"], float(turns.strip().replace("−", "-")))


@pytest.mark.parametrize(("kind", "rows", "n"), KIND_ROWS, ids=[row[0] for row in KIND_ROWS])
def test_a_kind_takes_as_many_freedoms_as_it_has_rows(kind, rows, n):
    """A free body has six; the note of rank is the file's own."""
    mechanism = ccpin.load(FOLDER / f"kind_{kind}.urdf")
    assert (mechanism.closures[0].kind, mechanism.mobility.rank, mechanism.n) == (kind, int(rows), int(n))
    assert int(rows) + int(n) == 6


def test_every_file_and_every_element_is_on_the_page():
    """Nothing lies about unseen, and no element or kind is without a file."""
    files = {path.relative_to(FOLDER).as_posix() for path in FOLDER.rglob("*") if path.is_file()}
    assert files == set(re.findall(r"\(elements/([\w./]+)\)", PAGE))
    written = "".join((FOLDER / name).read_text(encoding="utf-8") for name in files)
    assert all(re.search(rf"<(drake:)?{element}\b", written) for element in (*READERS, "coupling", "mimic"))
    assert {kind for kind, *_ in KIND_ROWS} == set(CLOSURE_KINDS)

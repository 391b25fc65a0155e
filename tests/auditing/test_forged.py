"""Documents that say what is false, with their fingerprints made right: refused, or not proved."""

import json
import os
from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin import domain
from ccpin.covering.cells import CellStatus
from ccpin.domain import certify, certify_sheets
from ccpin.errors import InvalidInputError
from tests.support.altered import changed

pytest.importorskip("flint")

from ccpin.auditing import closures, exclusion, reading, singular_curves, verify
from tests.support.forgeries import campaign

FORGERIES = int(os.environ.get("CCPIN_FORGERIES", "1000"))
WINDOW = ((-2.4, -1.8), (-1.4, -0.8))  # of the RPDR: certified, empty, singular and undecided cells


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("forged")


@pytest.fixture(scope="module")
def atlas(folder):
    """An RPDR's, and its file."""
    found = certify(ccpin.load("rpdr"), (-1.885, -1.257), WINDOW, max_depth=2)
    found.save(folder / "atlas.json")
    return found, folder / "atlas.json"


@pytest.fixture(scope="module")
def circle(folder):
    """A four-bar's, over a full turn, and its file."""
    found = certify(ccpin.load("four_bar"), (0.7,), max_depth=6)
    found.save(folder / "circle.json")
    return found, folder / "circle.json"


@pytest.fixture(scope="module")
def sheets(folder):
    """Both of an RPDR's, and their file."""
    found = certify_sheets(ccpin.load("rpdr"), WINDOW, max_depth=3)
    found.save(folder / "sheets.json")
    return found, folder / "sheets.json"


@pytest.fixture(scope="module")
def cover(folder, rpdr_curves):
    """Of an RPDR's self-motion and a piece of its fold."""
    rpdr_curves.save(folder / "cover.json")
    return rpdr_curves, folder / "cover.json"


def refused(made, tmp_path, field, change=lambda arrays: None, **header):
    """Whether the document, changed, is refused, and that the field is named."""
    with pytest.raises(InvalidInputError, match=rf"changed\.json: .*{field}"):
        verify(changed(made[1], tmp_path, change, **header), sample=1)


def test_all_documents_hold_as_they_are(atlas, circle, sheets, cover):
    for made in (atlas, circle, sheets, cover):
        assert verify(made[1], sample=3).holds


def test_leaves_called_certified_without_a_box(atlas, sheets, tmp_path):
    """All that are not, of an atlas and of sheets."""

    def certify_all(arrays):
        arrays["tree_status"][arrays["tree_child"] < 0] = CellStatus.CERTIFIED
        for name in ("singular_cell", "singular_theta"):
            arrays[name] = arrays[name][:0]

    refused(atlas, tmp_path, "tree_box", certify_all)
    refused(sheets, tmp_path, "count", certify_all)


def test_a_box_lent_to_another_cell(atlas, tmp_path):
    """Two certified cells that change boxes, and one that has another's."""
    cells = atlas[0].tree.leaves(CellStatus.CERTIFIED)[:2]

    def swap(arrays):
        arrays["tree_box"][cells] = arrays["tree_box"][cells[::-1]]

    def lend(arrays):
        arrays["tree_box"][cells[0]] = arrays["tree_box"][cells[1]]

    refused(atlas, tmp_path, "is not the box of cell", swap)
    refused(atlas, tmp_path, "tree_box", lend)


@pytest.mark.parametrize("radius", [3.0, -1.0])
def test_a_radius_that_is_not_certified(atlas, tmp_path, radius):
    refused(atlas, tmp_path, "'radius'", radius=radius)


def test_a_radius_that_is_certified_and_more(atlas, circle, tmp_path):
    """Some roundings more is too much; half of it is true."""
    for found, path in (atlas, circle):
        refused((found, path), tmp_path, "'radius'", radius=found.radius * (1.0 + 1e-11))
        assert verify(changed(path, tmp_path, lambda arrays: None, radius=0.5 * found.radius), sample=1).holds


def test_trees_that_do_not_tile(atlas, sheets, tmp_path):
    """Without leaves, rerouted, in a ring, moved, of other edges, cut elsewhere, and with cells that nobody reaches."""

    def reroute(arrays):
        splits = np.flatnonzero(arrays["tree_child"] >= 0)
        arrays["tree_child"][splits[:2]] = arrays["tree_child"][splits[1::-1]]

    def set_to(name, row, value):
        def change(arrays):
            arrays[name][row] = value

        return change

    for made in (atlas, sheets):
        tree = made[0].tree
        refused(made, tmp_path, "tree", reroute)
        refused(made, tmp_path, "tree", set_to("tree_child", slice(None), 0))
        refused(made, tmp_path, "tree", set_to("tree_child", 3, 0))
        refused(made, tmp_path, "tree", set_to("tree_child", np.flatnonzero(tree.child >= 0)[-1], -1))
        refused(made, tmp_path, "tree", set_to("tree_child", 0, 10**9))
        refused(made, tmp_path, "tree", set_to("tree_lower", 5, 1))
        refused(made, tmp_path, "tree", set_to("tree_size", 5, 1))
        refused(made, tmp_path, "tree", set_to("tree_cut", 0, 1 - tree.cut[0]))
        refused(made, tmp_path, "tree", set_to("tree_status", 0, CellStatus.CERTIFIED))
        refused(made, tmp_path, "tree", set_to("tree_status", -1, 7))


def test_boxes_whose_parameters_are_not_q(atlas, sheets, tmp_path):
    """D[independent] ≠ I."""

    def turn(arrays):
        arrays["box_directions"][0, arrays["system_independent"][0], 1] = 0.1

    for made in (atlas, sheets):
        refused(made, tmp_path, "box_directions", turn)


def test_seeds_and_names_of_another_claim(atlas, tmp_path):
    """A q₀ that is not the seed's, a seed that closes nothing, names that are a dependent joint's or another's."""

    def elsewhere(arrays):
        arrays["q0"] = arrays["q0"] + 0.01

    def open_seed(arrays):
        arrays["seed"][arrays["system_dependent"]] += 1e-3

    refused(atlas, tmp_path, "q0", elsewhere)
    for names in (["joint1", "joint3"], ["joint2", "joint1"], ["joint1"], ["joint1", "x"]):
        refused(atlas, tmp_path, "'names'", names=names)
    assert not verify(changed(atlas[1], tmp_path, open_seed), sample=1).holds


def test_joints_called_by_another_name(atlas, sheets, cover, tmp_path):
    """Both driven joints' names, swapped in all places: what joints are called is not looked at but with a model."""
    for load, made in (
        (domain.Atlas.load, atlas),
        (domain.SheetAtlas.load, sheets),
        (domain.SingularCover.load, cover),
    ):
        other = {"joint1": "joint2", "joint2": "joint1"}
        header = {
            "joints": [
                [other.get(joint[0], joint[0]), *joint[1:]] for joint in json.loads(made[1].read_text())["joints"]
            ],
            "names": ["joint2", "joint1"],
        }
        path = changed(made[1], tmp_path, lambda arrays: None, **header)
        assert "what joints are called" in verify(path, sample=1).not_checked
        assert load(made[1]).is_about(ccpin.load("rpdr"))
        assert not load(path).is_about(ccpin.load("rpdr"))


def test_regions_that_close_on_themselves_and_do_not(atlas, sheets, cover, tmp_path):
    def wrap(arrays):
        arrays["wrapped"][:] = True

    for made in (atlas, sheets, cover):
        refused(made, tmp_path, "wrapped", wrap)


def test_coordinates_called_periodic_that_are_not(tmp_path):
    """The slide of a slider-crank, and a joint of a workspace that has a limit."""
    found = certify(ccpin.load("slider_crank"), (0.7,), max_depth=4)
    found.save(tmp_path / "slider.json")

    def turn(arrays):
        arrays["system_periodic"][:] = True

    refused((found, tmp_path / "slider.json"), tmp_path, "system_periodic", turn)


def test_regions_without_numbers(atlas, tmp_path):
    """Infinite, not a number, upside down, and nothing."""

    def set_to(value):
        def change(arrays):
            arrays["lower"][0] = value

        return change

    for value in (np.nan, np.inf, 1e300):
        refused(atlas, tmp_path, "lower|NaN|Infinity", set_to(value))
    refused(atlas, tmp_path, "lower", set_to(0.0))


def test_lengths_beyond_any_mechanism(atlas, cover, tmp_path):
    """One number that made an audit take minutes, or overflow."""

    def huge(arrays):
        arrays["chain0_tip"][0] = 1e300

    def bent(arrays):
        arrays["chain0_rotations"][0] *= 2.0

    for made in (atlas, cover):
        refused(made, tmp_path, "chain0_tip", huge)
        refused(made, tmp_path, "chain0_rotations", bent)


def test_chains_that_enter_no_row(tmp_path):
    """Of other closures, which the document is about then: nothing of it is proved, and nothing breaks."""
    certify(ccpin.load("slider_crank"), (0.7,), max_depth=4).save(tmp_path / "slider.json")

    def idle(arrays):
        for name in [name for name in arrays if name.endswith("_weights")]:
            arrays[name][:] = 0.0

    assert not verify(changed(tmp_path / "slider.json", tmp_path, idle)).holds


def test_arrays_and_fields_that_nobody_knows(atlas, sheets, cover, tmp_path):
    """Unknown, missing, of another shape or dtype; and formats from before."""

    def more(arrays):
        arrays["spare"] = np.zeros(3)

    def fewer(arrays):
        del arrays["lower"]

    def other_kind(arrays):
        arrays["upper"] = arrays["upper"] > 0.0

    def other_shape(arrays):
        arrays["upper"] = arrays["upper"][:1]

    for made in (atlas, sheets, cover):
        refused(made, tmp_path, "'spare'", more)
        refused(made, tmp_path, "'lower'", fewer)
        refused(made, tmp_path, "upper: the dtype is bool", other_kind)
        refused(made, tmp_path, "upper: the shape", other_shape)
        refused(made, tmp_path, "'scale'", scale=1e18)
        refused(made, tmp_path, "'nq'", nq=True)
    for old in ("ccpin-atlas-4", "ccpin-sheets-1", "ccpin-curves-1"):
        refused(atlas, tmp_path, f"the format is '{old}', not", format=old)


def test_tubes_say_nothing_that_follows(cover, tmp_path):
    """A bound of |e| of 1.5 had regular poses on a curve: it is formed anew, and wider ones are none of the tube's."""
    found, path = cover

    def wide(arrays):
        arrays["tube_hull"] = np.full_like(arrays["tube_radius"], 1.5)

    refused(cover, tmp_path, "'tube_hull'", wide)
    again = domain.SingularCover.load(path)
    for one, other in zip(found.curves, again.curves, strict=True):
        for name in ("gain", "kappa", "hull"):
            np.testing.assert_allclose(getattr(one.tubes, name), getattr(other.tubes, name), rtol=1e-9, atol=1e-15)
    tubes = found.curves[0].tubes
    assert found.verify()
    forged = found.curves[0]._replace(tubes=tubes._replace(hull=np.full_like(tubes.hull, 1.5)))
    assert not replace(found, curves=(forged, *found.curves[1:])).verify()


def test_a_tube_that_is_not_proved_is_not_loaded(cover, tmp_path):
    def wider(arrays):
        arrays["tube_radius"][2] *= 100.0

    with pytest.raises(InvalidInputError, match="tube 2 is not proved"):
        domain.SingularCover.load(changed(cover[1], tmp_path, wider))


def test_sheets_told_apart_that_are_one(sheets, tmp_path):
    """Without gluing there would be as many sheets as boxes: at faces of certified cells they are seen to be one."""

    def unglue(arrays):
        for name in [name for name in arrays if name.startswith("glued_")]:
            arrays[name] = arrays[name][:0]

    audit = verify(changed(sheets[1], tmp_path, unglue), sample=6)
    assert audit.refuted
    assert next(claim for claim in audit.claims if "two sheets" in claim.what).failed
    assert f"{len(sheets[0].boxes.kappa)} sheets" in audit.claim
    assert "2 sheets" in verify(sheets[1], sample=1).claim


def test_a_curve_listed_twice(cover, tmp_path):
    """Bit for bit, and from other tubes of the same curve."""
    found, path = cover
    first = np.arange(len(found.curves[0].radius))

    def twice(shrink):
        def change(arrays):
            for name in [name for name in arrays if name.startswith("tube_")]:
                arrays[name] = np.concatenate([arrays[name], arrays[name][first]])
            arrays["tube_half"][-len(first) :] *= shrink
            arrays["curve_tubes"] = np.append(arrays["curve_tubes"], len(first))
            arrays["curve_closed"] = np.append(arrays["curve_closed"], found.curves[0].closed)

        return change

    for shrink in (1.0, 0.999):
        read = reading.read(changed(path, tmp_path, twice(shrink)))
        again = exclusion.Exclusion(closures.BallClosures(read), read)
        last = len(read.tubes) - 1
        assert singular_curves.listed_once(again, 0) is False
        assert singular_curves.listed_once(again, last) is False
    read = reading.read(path)
    assert singular_curves.listed_once(exclusion.Exclusion(closures.BallClosures(read), read), 0) is True
    assert "tubes whose curve is no other one on the list" in [claim.what for claim in verify(path, sample=1).claims]


def test_what_encloses_singular_configurations_is_told_as_not_looked_at(sheets, tmp_path):
    """Emptied, it is a start for fewer cusps, and no claim."""

    def empty(arrays):
        for name in [name for name in arrays if name.startswith("left_")]:
            arrays[name] = arrays[name][:0]

    audit = verify(changed(sheets[1], tmp_path, empty), sample=2)
    assert "what encloses singular configurations" in audit.not_checked


def test_iterations_that_do_not_converge_are_not_loaded(atlas, sheets, tmp_path):
    """Ã, w and κ are no part of what the auditor proves: the loader proves each box with them."""

    def still(arrays):
        arrays["box_preconditioner"][1] = 0.0

    def fast(arrays):
        arrays["box_kappa"][1] *= 0.5

    for change in (still, fast):
        for load, made in ((domain.Atlas.load, atlas), (domain.SheetAtlas.load, sheets)):
            with pytest.raises(InvalidInputError, match="box 1 is not proved"):
                load(changed(made[1], tmp_path, change))


def test_shares_are_those_of_the_cells(atlas, sheets):
    """What the auditor says of the region is what the producer does."""
    for found, path in (atlas, sheets):
        claim = verify(path, sample=1).claim
        assert f"{100 * found.certified_fraction:.6g} % certified" in claim
        assert f"{100 * found.empty_fraction:.6g} % empty" in claim


@pytest.mark.slow
def test_no_more_is_looked_at_where_enough_is_not_proved(atlas, tmp_path):
    """So that a document made to take time takes a bounded one; two processes say what one does."""

    def flat(arrays):
        arrays["box_modes"][:] = 0.0

    path = changed(atlas[1], tmp_path, flat)
    alone, shared = (verify(path, sample=12, workers=workers) for workers in (1, 2))
    assert alone.claims == shared.claims
    assert (alone.claims[0].checked, len(alone.claims[0].undecided)) == (8, 8)
    assert not alone.holds
    assert not alone.refuted


@pytest.mark.slow
def test_no_forged_document_is_accepted_that_is_false():
    """Some hundred; ``python -m tests.support.forgeries`` makes as many as there is time for."""
    happened, false, _ = campaign(FORGERIES)
    assert sum(happened.values()) == FORGERIES
    assert not false


@pytest.mark.slow
def test_changed_documents_of_every_kind_are_accepted_only_where_they_are_true():
    """A few of what the campaign makes."""
    happened, false, _ = campaign(12, seed=3)
    assert not false
    assert sum(happened.values()) == 12

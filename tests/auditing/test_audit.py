"""The auditor: it proves what is true, finds what was planted, and shares no code with the producer."""

import ast
import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import ccpin
from ccpin.cli import main
from ccpin.domain import Atlas, certify, merge, split_region
from ccpin.errors import InvalidInputError

pytest.importorskip("flint")

from ccpin import auditing
from ccpin.auditing import boxes, closures, gluing, reading, verify
from tests.support.altered import changed
from tests.support.long_cases import later

CASES = {
    "four_bar": ((0.7,), None, 8, None),
    "rpdr": ((-1.885, -1.257), ((-2.4, -1.8), (-1.4, -0.8)), 4, 20),
    "slider_crank": ((0.7,), None, 8, None),
    "planar_3rrr": ((-0.675, 1.419, -2.769), ((-1.175, 0.919, -3.269), (-0.175, 1.919, -2.269)), 1, 2),
}


@pytest.fixture(
    scope="module",
    params=[*list(CASES)[:3], pytest.param("planar_3rrr", marks=pytest.mark.slow)],
)
def case(request, tmp_path_factory):
    q0, region, depth, sample = CASES[request.param]
    mechanism = ccpin.load(request.param)
    atlas = certify(mechanism, q0, region, max_depth=depth)
    path = tmp_path_factory.mktemp("audit") / "atlas.json"
    atlas.save(path)
    return mechanism, atlas, path, sample


def test_true_claims_are_proved(case):
    _, atlas, path, sample = case
    audit = verify(path, sample=sample)
    assert audit.holds, str(audit)
    assert audit.claims[0].of == len(atlas.boxes.kappa)
    assert audit.claims[1].of > 0 or len(atlas.boxes.kappa) == 1
    assert audit.whole == (sample is None)
    assert "Theorem N" in audit.theorem


@pytest.mark.parametrize("held", later(0, 1, 2))
def test_a_slice_is_proved_and_reached(held, tmp_path):
    """Over a slice, boxes touch in the coordinates that are not held; without its faces nothing else is reached."""
    q = np.array(CASES["planar_3rrr"][0])
    width = np.where(np.arange(3) == held, 0.0, 0.8)
    atlas = certify(ccpin.load("planar_3rrr"), q, (q - width, q + width), max_depth=3)
    assert len(atlas.boxes.kappa) > 1
    path = tmp_path / "slice.json"
    atlas.save(path)
    audit = verify(path, sample=2)
    assert audit.claims[1].of > 0
    assert audit.holds, str(audit)

    def apart(arrays):
        faces = [(c.first, c.second) for c in gluing.contacts(reading.read(path))]
        arrays["unglued"] = np.array(faces, dtype=np.int64)

    with pytest.raises(InvalidInputError, match="radius"):
        verify(changed(path, tmp_path, apart), sample=2)
    assert verify(changed(path, tmp_path, apart, radius=0.0), sample=2).claims[2].failed


@pytest.mark.parametrize("case", ["rpdr"], indirect=True)
def test_threads_audit_each_its_own_document(case, tmp_path):
    """Two documents at once, one of them false: each audit is of its own."""
    _, _, path, _ = case

    def narrowed(arrays):
        arrays["box_radius"] = arrays["box_radius"] * 1e-12

    false = changed(path, tmp_path, narrowed)
    with ThreadPoolExecutor(2) as pool:
        audits = list(pool.map(lambda p: verify(p, sample=2), [path, false] * 2))
    assert [audit.holds for audit in audits] == [True, False] * 2


def test_closures_are_those_of_the_mechanism(case):
    """The auditor's φ vanishes at the reference's σ, whose φ is Pinocchio's; φ_θ is its derivative."""
    mechanism, atlas, path, _ = case
    read = reading.read(path)
    own, model = closures.BallClosures(read), ccpin.ReducedModel(mechanism)
    rng = np.random.default_rng(5)
    near = atlas.reading.configuration(read.seed[None])[0]
    for q in atlas.q0 + 0.05 * rng.uniform(-1.0, 1.0, (10, len(atlas.q0))):
        theta = atlas.reading.theta(model.sigma(q, near))
        np.testing.assert_allclose(own.at(theta)[0], 0.0, atol=1e-11)
    theta = read.seed + 0.3 * rng.normal(size=len(read.seed))
    steps = 1e-6 * np.eye(len(theta))
    numeric = np.stack([(own.at(theta + d)[0] - own.at(theta - d)[0]) / 2e-6 for d in steps], axis=1)
    np.testing.assert_allclose(own.at(theta)[1], numeric, atol=1e-8)


def test_the_variation_is_the_jacobian_s_derivative(case):
    read = reading.read(case[2])
    own = closures.BallClosures(read)
    rng = np.random.default_rng(6)
    theta, direction = read.seed + 0.2 * rng.normal(size=len(read.seed)), rng.normal(size=len(read.seed))
    motions = own.motions([closures.arb(float(x)) for x in theta])
    rate = closures.floats(own.variation(motions, [closures.arb(float(x)) for x in direction]))
    numeric = (own.at(theta + 1e-6 * direction)[1] - own.at(theta - 1e-6 * direction)[1]) / 2e-6
    np.testing.assert_allclose(rate, numeric, atol=1e-8)


def test_a_box_too_wide_is_found(case, tmp_path):
    """One box of the larger ones claims more than it has; it reaches beyond what is closed or turns singular."""
    _, atlas, path, _ = case
    k = int(np.argmax(atlas.boxes.half.max(axis=1)))
    read = reading.read(path)
    read.half[k] = np.maximum(3.0 * read.half[k], 4.0)
    assert not boxes.proved(closures.BallClosures(read), read, k, 6)

    def widen(arrays):
        arrays["box_half"][k] = read.half[k]

    with pytest.raises(InvalidInputError, match="is not the box of cell"):
        reading.read(changed(path, tmp_path, widen))


@pytest.mark.parametrize("what", ["tube", "modes", "centre"])
def test_a_wrong_tube_is_found(case, what):
    """A tube that holds no solution, one that is flat, and one beside the branch."""
    read = reading.read(case[2])
    if what == "tube":
        read.radius[0] *= -1.0
    elif what == "modes":
        read.modes[0] = 0.0
    else:
        read.centre[0, read.dependent[0]] += 20.0 * read.radius[0].max() + 0.1
    assert not boxes.proved(closures.BallClosures(read), read, 0, 4)


def test_a_box_on_another_branch_is_not_glued(tmp_path):
    """Two boxes of one four-bar, the second one of the other assembly mode: each holds, their face does not."""
    mechanism = ccpin.load("four_bar")
    atlas = certify(mechanism, (0.7,), max_depth=6)
    other_way = certify(mechanism, (0.7,), None, mirrored(mechanism), max_depth=6)
    assert len(atlas.boxes.kappa) > 1
    assert not np.allclose(atlas.seed, other_way.seed)
    atlas.save(tmp_path / "a.json")
    k, partner = next(
        (k, j)
        for k in range(len(atlas.boxes.kappa))
        for j in range(len(other_way.boxes.kappa))
        if np.allclose([atlas.lower[k], atlas.upper[k]], [other_way.lower[j], other_way.upper[j]])
    )

    def swap(arrays):
        for name in ("centre", "directions", "modes", "radius", "half"):
            arrays[f"box_{name}"][k] = getattr(other_way.boxes, name)[partner]

    audit = verify(changed(tmp_path / "a.json", tmp_path, swap))
    assert not audit.claims[0].failed
    assert [k in pair for pair in audit.claims[1].failed] == [True, True]
    assert not audit.holds


def mirrored(mechanism):
    """A closed configuration of the other assembly mode at q = 0.7."""
    model = ccpin.ReducedModel(mechanism)
    rng = np.random.default_rng(0)
    first = model.sigma([0.7])
    for _ in range(200):
        try:
            other = model.sigma([0.7], first + rng.uniform(-2.0, 2.0, len(first)))
        except ccpin.CcpinError:
            continue
        if not np.allclose(np.cos(other), np.cos(first), atol=1e-3):
            return other
    raise AssertionError("the other mode was not found")


def test_another_mechanism_s_closures_are_refused(case, tmp_path):
    mechanism, atlas, path, _ = case

    def longer(arrays):
        arrays["chain0_tip"] += 1e-3

    with pytest.raises(InvalidInputError, match="fingerprint"):
        reading.read(changed(path, tmp_path, longer, stamp=False))
    read = reading.read(changed(path, tmp_path, longer))
    assert read.header["fingerprint"] != atlas.fingerprint
    assert atlas.is_about(mechanism)
    assert not atlas.is_about(ccpin.load("hexa"))


def test_npz_and_json_say_the_same(case, tmp_path):
    _, atlas, path, _ = case
    atlas.save(tmp_path / "a.npz")
    one, two = reading.read(path), reading.read(tmp_path / "a.npz")
    assert one.faces is None is two.faces
    names = [field.name for field in fields(reading.ClaimedDocument)]
    plain = [*names[2 : names.index("faces")], "place", "size"]
    for a, b in zip(*([*(getattr(d, n) for n in plain), *d.empty, *d.singular] for d in (one, two)), strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(one.witnesses, two.witnesses)
    np.testing.assert_array_equal(Atlas.load(path).boxes.centre, Atlas.load(tmp_path / "a.npz").boxes.centre)


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"format": "ccpin-atlas-5", "arrays": {}}', '{"arrays": []}'])
def test_what_is_no_certificate_is_refused(tmp_path, text):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(InvalidInputError):
        verify(tmp_path / "a.json")


@pytest.mark.slow
def test_workers_say_the_same(tmp_path):
    atlas = certify(ccpin.load("four_bar"), (0.7,), max_depth=6)
    atlas.save(tmp_path / "a.npz")
    seen = []
    assert verify(tmp_path / "a.npz", workers=2, progress=seen.append).claims == verify(tmp_path / "a.npz").claims
    assert seen[-1].done == seen[-1].of > 0


def test_the_command(tmp_path, capsys):
    path = tmp_path / "a.json"
    certify(ccpin.load("four_bar"), (0.7,), max_depth=4).save(path)
    assert main(["verify", str(path), "--model", "four_bar", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["holds"], told["refuted"], told["whole"], told["model"]) == (True, False, True, True)
    assert main(["verify", str(path), "--model", "rpdr"]) == 4
    assert "NOT the same" in capsys.readouterr().out

    def flat(arrays):
        arrays["box_modes"][0] = 0.0

    def beside(arrays):
        arrays["box_centre"][0, arrays["system_dependent"][0]] += 0.5

    for change, code, word in ((flat, 3, "not decided: 0"), (beside, 4, "FALSE: 0")):
        assert main(["verify", str(changed(path, tmp_path, change))]) == code
        assert word in capsys.readouterr().out


def test_it_imports_nothing_of_the_producer():
    for path in Path(auditing.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert all(n.startswith("ccpin.auditing") or n == "ccpin.errors" for n in names if n.startswith("ccpin")), (
                path
            )


def test_touching_boxes_are_found(tmp_path):
    """Contacts against a count by corners, all pairs."""
    atlas = certify(ccpin.load("rpdr"), (-1.885, -1.257), ((-2.4, -1.8), (-1.4, -0.8)), max_depth=4)
    low, high = atlas.lower, atlas.upper
    gap = np.minimum(high[:, None], high) - np.maximum(low[:, None], low)
    touch = (np.sum(np.abs(gap) < 1e-9, axis=2) == 1) & np.all(gap > -1e-9, axis=2)
    expected = {(int(a), int(b)) for a, b in np.argwhere(np.triu(touch, 1))}
    atlas.save(tmp_path / "a.npz")
    found = {tuple(sorted((c.first, c.second))) for c in gluing.contacts(reading.read(tmp_path / "a.npz"))}
    assert found == expected


def test_boxes_beside_an_isolated_singularity_are_proved(tmp_path):
    """Their tubes are long in the weak direction, and true: large terms cancel there, and are to do so in balls."""
    mechanism = ccpin.load("rpdr")
    seed = np.array([0.51656358, 2.49747313])  # some degrees from where the elbows coincide
    region = (seed - 0.01, np.array([1.02, 2.52]))
    atlas = certify(mechanism, seed, region, max_depth=4)
    weak = np.argsort(np.abs(atlas.boxes.modes[:, 0, 1]) > 0.0)[::-1]
    assert np.abs(atlas.boxes.modes[weak[0], 0, 1]) > 0.5
    atlas.save(tmp_path / "a.npz")
    read = reading.read(tmp_path / "a.npz")
    own = closures.BallClosures(read)
    assert all(boxes.proved(own, read, int(k), 8) for k in weak[:12])


def test_an_atlas_merged_over_a_full_turn_has_a_radius(tmp_path):
    """It was infinite, so that the document could not be saved as JSON, nor be read by the auditor as npz."""
    mechanism, whole = ccpin.load("four_bar"), ((-np.pi,), (np.pi,))
    one = certify(mechanism, (0.7,), whole, max_depth=6)
    parts = [
        certify(mechanism, 0.5 * (low + high), (low, high), one.sigma(0.5 * (low + high)), max_depth=6)
        for low, high in split_region(whole, 2)
    ]
    merged = merge(parts)
    assert merged.radius == pytest.approx(one.radius)
    for name in ("merged.json", "merged.npz"):
        merged.save(tmp_path / name)
        assert verify(tmp_path / name).holds


def test_what_is_not_cut_deep_enough_is_not_decided(case, monkeypatch):
    """Boxes, whose claims are true, are neither proved nor called false where they are not cut at all."""
    monkeypatch.setattr("ccpin.auditing.looking._CUTS", 0)
    monkeypatch.setattr(boxes, "holds", lambda *arguments, **options: False)
    found = verify(case[2], sample=2)
    assert found.claims[0].undecided
    assert not found.claims[0].failed
    assert not found.holds
    assert not found.refuted
    assert "not decided" in str(found)
    assert "FALSE" not in str(found)

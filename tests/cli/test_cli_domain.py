"""`ccpin domain`: radii, atlas, figures, files, and a Dask cluster."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from ccpin.cli import main
from ccpin.description.finding import find_file
from ccpin.domain import Atlas, SheetAtlas, SingularCover, certified_radius, singularities
from ccpin.domain.singular.curves import UncoveredBoxes
from tests.support.long_cases import later

CENTRE = ["--centre-deg", "-108", "-72"]
REGION = ["--lower-deg", "-150", "-160", "--upper-deg", "-90", "-100"]


def test_radii_in_words_and_json(capsys):
    """Theorem 2, the one-box certificate and the atlas, none above the exact 15.0557°."""
    assert main(["domain", "rpdr", *CENTRE]) == 0
    assert "Theorem 2" in capsys.readouterr().out
    assert main(["domain", "rpdr", *CENTRE, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    radii = np.degrees([facts["theorem2_radius"], facts["kantorovich_radius"], facts["atlas"]["radius"]])
    assert np.all(radii > 3.5)
    assert np.all(radii < 15.0557)
    assert facts["atlas"]["single_valued"]


@pytest.mark.parametrize("starts", later(3, 10))
def test_a_region_with_its_files(tmp_path, capsys, monkeypatch, starts):
    """The region used for control is certified whole; atlas and figures are written and can be used."""
    monkeypatch.setattr("ccpin.domain.singularities", partial(singularities, starts=starts))
    out = [*REGION, "--centre-deg", "-120", "-130", "--save", str(tmp_path / "atlas.npz"), "--plot", str(tmp_path)]
    assert main(["domain", "rpdr", *out, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["atlas"]["certified_fraction"] == 1.0
    atlas = Atlas.load(tmp_path / "atlas.npz")
    assert atlas.verify().all()
    assert {p.suffix for p in tmp_path.iterdir()} == {".npz", ".png"}
    assert len(list(tmp_path.glob("*.png"))) == 3


def test_the_radius_map_is_the_distance_to_what_is_not_certified(tmp_path):
    """At the seed it is the atlas's radius; no point within it is uncertified, and just beyond one is."""
    assert main(["domain", "rpdr", *CENTRE, "--atlas", "--depth", "7", "--save", str(tmp_path / "a.npz")]) == 4
    atlas = Atlas.load(tmp_path / "a.npz")
    assert certified_radius(atlas, atlas.q0)[0] == pytest.approx(atlas.radius, rel=1e-9)
    generator = np.random.default_rng(1)
    points = generator.uniform(-np.pi, np.pi, (16, 2))
    points = points[atlas.contains(points)]
    for q, radius in zip(points, certified_radius(atlas, points), strict=True):
        assert atlas.contains(q + radius * 0.999999 * generator.uniform(-1, 1, (400, 2))).all()
        edge = np.linspace(-1, 1, 4001)
        rim = np.concatenate([np.column_stack([s * np.ones_like(edge), edge]) for s in (-1, 1)])
        rim = np.concatenate([rim, rim[:, ::-1]])
        assert not atlas.contains(q + (radius + 1e-3) * rim).all()


def test_continuous_joints_are_certified_by_their_angles(tmp_path, capsys):
    """A five-bar on continuous joints has the radii of the one on revolute joints."""
    text = find_file("rpdr").read_text()
    for joint in ("joint1", "joint2", "joint3", "joint4"):
        text = text.replace(f'<joint name="{joint}" type="revolute"', f'<joint name="{joint}" type="continuous"')
    (tmp_path / "turning.urdf").write_text(text)
    radii = []
    for name in ("rpdr", str(tmp_path / "turning.urdf")):
        assert main(["domain", name, "--json"]) == 0
        facts = json.loads(capsys.readouterr().out)
        radii.append((facts["kantorovich_radius"], facts["atlas"]["radius"]))
    assert radii[0] == pytest.approx(radii[1], rel=1e-6)


def test_bad_requests_are_named(capsys):
    """Half a region, a scheduler that does not answer, a mechanism no certificate covers."""
    assert main(["domain", "rpdr", "--lower-deg", "-150", "-160"]) == 1
    assert "corner" in capsys.readouterr().err
    assert main(["domain", "bennett"]) == 1
    assert "UnsupportedMechanismError" in capsys.readouterr().err


def test_workers_give_the_same_atlas(tmp_path, capsys):
    """With --workers 2 the boxes are those of this process, bit for bit; none is refused."""
    request = ["domain", "rpdr", *REGION, "--centre-deg", "-120", "-130", "--json"]
    assert main([*request, "--save", str(tmp_path / "here.npz")]) == 0
    assert main([*request, "--save", str(tmp_path / "there.npz"), "--workers", "2"]) == 0
    here, there = Atlas.load(tmp_path / "here.npz"), Atlas.load(tmp_path / "there.npz")
    for name, array in here.boxes._asdict().items():
        assert np.array_equal(array, getattr(there.boxes, name)), name
    with pytest.raises(SystemExit, match="2"):
        main([*request, "--workers", "0"])
    assert "argument --workers: must be a whole number, 1 or more" in capsys.readouterr().err


@pytest.mark.slow
def test_a_dask_cluster_gives_the_same_atlas(tmp_path, capsys):
    """With --scheduler and two worker processes the boxes are those of this process, bit for bit."""
    distributed = pytest.importorskip("distributed")
    request = ["domain", "rpdr", *REGION, "--centre-deg", "-120", "-130", "--json"]
    assert main([*request, "--save", str(tmp_path / "here.npz")]) == 0
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=None
    ) as cluster:
        address = cluster.scheduler_address
        assert main([*request, "--save", str(tmp_path / "there.npz"), "--scheduler", address]) == 0
    here, there = Atlas.load(tmp_path / "here.npz"), Atlas.load(tmp_path / "there.npz")
    for name, array in here.boxes._asdict().items():
        assert np.array_equal(array, getattr(there.boxes, name)), name
    capsys.readouterr()


def test_sheets_are_counted_and_saved(tmp_path, capsys):
    """`--sheets` counts every assembly mode, in words and as JSON, and saves a document; it takes no centre."""
    path = tmp_path / "sheets.json"
    assert main(["domain", "slider_crank", "--sheets", "--save", str(path)]) == 0
    told = capsys.readouterr().out
    assert "assembly modes over one q, proved: 2" in told
    assert "sheet 1:" in told
    assert SheetAtlas.load(path).certified_fraction == 1.0
    assert main(["domain", "slider_crank", "--sheets", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["counts"], facts["certified_fraction"], facts["complete"]) == ([2], 1.0, True)
    assert [sheet["sign"] for sheet in facts["sheets"]] in ([1, -1], [-1, 1])
    assert main(["domain", "slider_crank", "--sheets", "--centre-deg", "40"]) == 1
    assert "no --centre" in capsys.readouterr().err


def test_singular_curves_are_told(tmp_path, capsys):
    """`--curves` finds a piece of the fold, in words, as JSON and as a figure; it takes no centre."""
    region = ["--lower-deg", "116", "50", "--upper-deg", "126", "60"]
    assert main(["domain", "rpdr", "--curves", *region, "--plot", str(tmp_path)]) == 0
    told = capsys.readouterr().out
    assert "rpdr: proven: every singular configuration" in told
    assert "curve 0: fold, open" in told
    assert (tmp_path / "singularities.png").stat().st_size > 0
    saved = str(tmp_path / "curves.json")
    assert main(["domain", "rpdr", "--curves", *region, "--json", "--save", saved]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["verdict"], facts["uncovered"], facts["complete"]) == ("proven", 0, True)
    assert [curve["kind"] for curve in facts["curves"]] == ["fold"]
    assert main(["verify", saved, "--model", "rpdr", "--sample", "2", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["holds"], told["model"], len(told["claims"])) == (True, True, 5)
    assert main(["domain", "rpdr", "--curves", "--centre-deg", "57", "123"]) == 1
    assert main(["domain", "rpdr", "--curves", "--depth", "3"]) == 1
    assert "--curves takes no --depth" in capsys.readouterr().err


@pytest.mark.slow
def test_workers_and_chunks_give_the_same_curves(tmp_path, capsys):
    """`--curves` with --workers 2 and a folder of chunks: the tubes of this process, bit for bit."""
    request = ["domain", "rpdr", "--curves", "--lower-deg", "100", "35", "--upper-deg", "140", "75", "--json"]
    more = ["--workers", "2", "--checkpoint", str(tmp_path / "chunks")]
    assert main([*request, "--save", str(tmp_path / "here.npz")]) == 0
    assert main([*request, "--save", str(tmp_path / "there.npz"), *more]) == 0
    here, there = (SingularCover.load(tmp_path / f"{name}.npz") for name in ("here", "there"))
    assert here.curves
    for one, other in zip(here.curves, there.curves, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(one.tubes, other.tubes, strict=True))
    assert here.tried == there.tried
    assert list((tmp_path / "chunks").glob("*.chunk"))
    capsys.readouterr()


@pytest.mark.parametrize(
    ("request_", "verdict", "code"),
    [
        (["--lower-deg", "-150", "-100", "--upper-deg", "-100", "-70", "--depth", "0", *CENTRE], "undecided", 3),
        (["--atlas", "--depth", "7", *CENTRE], "refuted", 4),
        ([*REGION, "--centre-deg", "-120", "-130"], "proven", 0),
    ],
)
def test_the_exit_code_of_an_atlas_is_its_verdict(request_, verdict, code, tmp_path, capsys):
    """A script can tell what is not decided from what is false; radii alone, as above, judge no region."""
    saved = ["--save", str(tmp_path / "atlas.npz")]
    assert main(["domain", "rpdr", *request_, *saved, "--json"]) == code
    assert json.loads(capsys.readouterr().out)["atlas"]["verdict"] == verdict


@pytest.mark.slow
def test_the_exit_codes_of_curves_undecided_and_of_a_merge(tmp_path, capsys, monkeypatch):
    """Curves that may not be all there are, and what is merged of them, end with 3."""
    region = ["--lower-deg", "40", "100", "--upper-deg", "60", "130"]
    cover = SingularCover.load(_saved_curves(tmp_path, region))
    boxes = UncoveredBoxes(*(np.zeros((1, 4)) for _ in range(2)))
    monkeypatch.setattr("ccpin.domain.certify_singularities", lambda *_, **__: replace(cover, uncovered=boxes))
    monkeypatch.setattr("ccpin.domain.merge", lambda parts: replace(cover, uncovered=boxes))
    assert main(["domain", "rpdr", "--curves", *region, "--json"]) == 3
    saved = str(tmp_path / "curves.npz")
    assert main(["merge", saved, saved, "--out", str(tmp_path / "whole.npz"), "--json"]) == 3


def _saved_curves(folder, region):
    assert main(["domain", "rpdr", "--curves", *region, "--json", "--save", str(folder / "curves.npz")]) == 0
    return folder / "curves.npz"

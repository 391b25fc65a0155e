"""Inertias that MJCF files leave to their meshes, against MuJoCo's compiled model of the same file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from ccpin.description.model import Inertia
from ccpin.errors import DescriptionError
from tests.support.mjcf_files import model
from tests.support.reading import read_mjcf

mujoco = pytest.importorskip("mujoco")


@pytest.fixture(autouse=True)
def _away(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run elsewhere, because MuJoCo writes its warnings to a file in the working folder."""
    monkeypatch.chdir(tmp_path)


def _bracket() -> trimesh.Trimesh:
    """An L, which is neither convex nor seen whole from its middle, away from the origin."""
    outline = np.array([[0, 0], [1, 0], [1, 0.1], [0.2, 0.1], [0.2, 1.5], [0, 1.5]])
    faces = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]
    low, high = np.c_[outline, np.zeros(6)], np.c_[outline, np.full(6, 0.3)]
    walls = [f for i in range(6) for f in ([i, (i + 1) % 6, (i + 1) % 6 + 6], [i, (i + 1) % 6 + 6, i + 6])]
    triangles = [face[::-1] for face in faces] + [[i + 6 for i in face] for face in faces] + walls
    return trimesh.Trimesh(np.r_[low, high] + [0.4, -0.2, 0.7], triangles, process=False)


MESHES = {
    "bracket": _bracket(),
    "tetrahedron": trimesh.Trimesh(
        [[0, 0, 0], [1, 0, 0], [0, 0.5, 0], [0.1, 0.2, 0.8]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    ),
    "ball": trimesh.creation.icosphere(subdivisions=1, radius=0.3).apply_scale([1, 2, 3]),
}


def _files(folder: Path, mesh: trimesh.Trimesh, suffix: str, asset: str, geom: str) -> Path:
    mesh.export(folder / f"m.{suffix}")
    body = f'<body name="a"><joint/><geom type="mesh" mesh="m" pos="0.1 0.2 -0.3" euler="10 20 30" {geom}/></body>'
    main = folder / "main.xml"
    main.write_text(model(body, head=f'<asset><mesh file="m.{suffix}" {asset}/></asset>'))
    return main


def _agrees(inertia: Inertia | None, main: Path) -> None:
    """Mass, centre and inertia in body axes are MuJoCo's, whose vertices are in single precision."""
    compiled = mujoco.MjModel.from_xml_path(str(main))
    quat = compiled.body_iquat[1]
    turn = Rotation.from_quat([*quat[1:], quat[0]]).as_matrix()
    expected = turn @ np.diag(compiled.body_inertia[1]) @ turn.T
    assert inertia is not None
    assert inertia.mass == pytest.approx(compiled.body_mass[1], rel=1e-6)
    np.testing.assert_allclose(inertia.com, compiled.body_ipos[1], rtol=0, atol=1e-6)
    np.testing.assert_allclose(inertia.rotational, expected, rtol=0, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("way", ["", 'inertia="legacy"', 'inertia="exact"', 'inertia="convex"', 'inertia="shell"'])
@pytest.mark.parametrize("suffix", ["stl", "obj"])
@pytest.mark.parametrize("shape", MESHES)
def test_meshes_weigh_what_mujoco_says(tmp_path: Path, shape: str, suffix: str, way: str) -> None:
    """Each word for a mesh's inertia, each kind of file; the mass from the default density."""
    main = _files(tmp_path, MESHES[shape], suffix, way, "")
    _agrees(read_mjcf(main.read_bytes(), str(main)).links[1].inertia, main)


def _as_msh(mesh: trimesh.Trimesh, faces: bool) -> bytes:
    """MuJoCo's binary format: counts of vertices, normals, texture coordinates and faces, then the numbers."""
    triangles = np.asarray(mesh.faces if faces else np.empty((0, 3)), dtype="<i4")
    counts = np.array([len(mesh.vertices), 0, 0, len(triangles)], dtype="<i4")
    return counts.tobytes() + np.asarray(mesh.vertices, dtype="<f4").tobytes() + triangles.tobytes()


@pytest.mark.parametrize("way", ["", 'inertia="exact"', 'inertia="convex"', 'inertia="shell"'])
@pytest.mark.parametrize("spelt", ["msh", "msh without faces", "in the model", "vertices in the model"])
@pytest.mark.parametrize("shape", MESHES)
def test_mujocos_own_meshes_and_those_written_into_the_model(tmp_path: Path, shape: str, spelt: str, way: str) -> None:
    """Without faces the mesh is its vertices' convex hull."""
    mesh, bare = MESHES[shape], "faces" in spelt or spelt.startswith("vert")
    said = 'file="m.msh"'
    if "msh" in spelt:
        (tmp_path / "m.msh").write_bytes(_as_msh(mesh, not bare))
    else:
        said = f'vertex="{" ".join(map(str, np.ravel(mesh.vertices)))}"'
        said += "" if bare else f' face="{" ".join(map(str, np.ravel(mesh.faces)))}"'
    body = '<body name="a"><joint/><geom type="mesh" mesh="m" pos="0.1 0.2 -0.3" euler="10 20 30"/></body>'
    main = tmp_path / "main.xml"
    main.write_text(model(body, head=f'<asset><mesh name="m" {said} scale="1 2 3" {way}/></asset>'))
    read = read_mjcf(main.read_bytes(), str(main))
    _agrees(read.links[1].inertia, main)
    assert len(read.links[1].visuals) == ("msh" in spelt)


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ('vertex="0 0 0 1 0"', "threes"),
        ('vertex="0 0 0 1 0 0 0 1 0 0 0 1" face="0 1 4"', "whole numbers from 0 to 3"),
        ('vertex="0 0 0 1 0 0 0 1 0 0 0 1" face="0 1 -1"', "whole numbers from 0 to 3"),
        ('vertex="0 0 0 1 0 0 0 1 0 0 0 1" face="0 1 1.5"', "whole numbers from 0 to 3"),
        ('vertex="0 0 0 1 0 0 2 0 0"', "cannot be read"),
        ('file="short.msh"', "cannot be read"),
        ('file="long.msh"', "counts of vertices and faces"),
        ('file="face.msh"', "vertex that is not there"),
    ],
)
def test_damaged_meshes_of_those_kinds(tmp_path: Path, said: str, message: str) -> None:
    """By the mesh's name."""
    (tmp_path / "short.msh").write_bytes(b"12")
    (tmp_path / "long.msh").write_bytes(np.array([2**31 - 1, 0, 0, 1], dtype="<i4").tobytes())
    (tmp_path / "face.msh").write_bytes(np.array([1, 0, 0, 1, 0, 0, 0, 0, 0, 5], dtype="<i4").tobytes())
    main = tmp_path / "main.xml"
    body = '<body name="a"><joint/><geom type="mesh" mesh="m"/></body>'
    main.write_text(model(body, head=f'<asset><mesh name="m" {said}/></asset>'))
    with pytest.raises(DescriptionError, match=f"mesh '(m|short.msh|long.msh|face.msh)': .*{message}"):
        read_mjcf(main.read_bytes(), str(main))


@pytest.mark.parametrize(
    "asset",
    [
        'scale="0.1 0.1 0.1"',
        'scale="1 2 3" refpos="0.3 0.1 -0.5" refquat="1 2 3 4"',
        'scale="1 -2 1" refpos="1 0 0"',
    ],
)
@pytest.mark.parametrize("geom", ['mass="2.5"', 'density="300"'])
@pytest.mark.parametrize("way", ["legacy", "exact", "convex", "shell"])
def test_scale_reference_pose_mass_and_density_are_mujocos(tmp_path: Path, asset: str, geom: str, way: str) -> None:
    """Scales (unequal and mirrored), reference poses, and a mass or density of the geom's own."""
    main = _files(tmp_path, MESHES["bracket"], "stl", f'inertia="{way}" {asset}', geom)
    _agrees(read_mjcf(main.read_bytes(), str(main)).links[1].inertia, main)


def test_an_open_mesh_is_legacy_convex_or_shell(tmp_path: Path) -> None:
    """What MuJoCo makes of an open surface is read the same; an exact inertia it has none, and is refused by name."""
    mesh = MESHES["bracket"].copy()
    mesh.update_faces(np.arange(len(mesh.faces)) > 0)
    for way in ("legacy", "convex", "shell"):
        main = _files(tmp_path, mesh, "stl", f'inertia="{way}"', "")
        _agrees(read_mjcf(main.read_bytes(), str(main)).links[1].inertia, main)
    main = _files(tmp_path, mesh, "stl", 'inertia="exact"', "")
    with pytest.raises(DescriptionError, match=r"m\.stl.*not closed"):
        read_mjcf(main.read_bytes(), str(main))


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, "no such file"),
        (b"", "m.stl"),
        (b"solid\nfacet\n", "m.stl"),
        (b"\0" * 200, "m.stl"),
        (b"\0" * 80 + b"\xff\xff\xff\x7f" + b"\0" * 50, "m.stl"),
    ],
)
def test_what_gives_no_inertia_is_refused_by_name(tmp_path: Path, content: bytes | None, reason: str) -> None:
    """Missing, empty and damaged files are errors that name the mesh."""
    main = _files(tmp_path, MESHES["ball"], "stl", "", "")
    (tmp_path / "m.stl").unlink() if content is None else (tmp_path / "m.stl").write_bytes(content)
    with pytest.raises(DescriptionError, match=reason):
        read_mjcf(main.read_bytes(), str(main))


def test_a_flat_mesh_has_no_volume_but_a_shell(tmp_path: Path) -> None:
    """A single plate is refused as a solid; as a shell it is the plate of the textbooks (MuJoCo wants a hull of it)."""
    plate = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    main = _files(tmp_path, plate, "stl", "", "")
    with pytest.raises(DescriptionError, match="volume"):
        read_mjcf(main.read_bytes(), str(main))
    main = _files(tmp_path, plate, "stl", 'inertia="shell"', "")
    inertia = read_mjcf(main.read_bytes(), str(main)).links[1].inertia
    assert inertia is not None
    assert inertia.mass == pytest.approx(1000.0)
    np.testing.assert_allclose(np.linalg.eigvalsh(inertia.rotational), 1000.0 / np.array([12.0, 12.0, 6.0]), rtol=1e-9)


def test_a_name_no_file_can_have_is_no_file(tmp_path: Path) -> None:
    """An overlong file name is our error, not the operating system's."""
    main = _files(tmp_path, MESHES["ball"], "stl", "", "")
    text = main.read_text().replace('file="m.stl"', f'name="m" file="{"x" * 400}.stl"')
    with pytest.raises(DescriptionError, match="no such file"):
        read_mjcf(text.encode(), str(main))


def test_older_files_ask_for_exact_inertias_of_all_meshes(tmp_path: Path) -> None:
    """The compiler's exactmeshinertia, which MuJoCo had before the mesh's own word, means inertia exact."""
    main = _files(tmp_path, MESHES["bracket"], "stl", 'inertia="exact"', "")
    old = (
        main.read_text()
        .replace(' inertia="exact"', "")
        .replace("<asset>", '<compiler exactmeshinertia="true"/><asset>')
    )
    _agrees(read_mjcf(old.encode(), str(main)).links[1].inertia, main)

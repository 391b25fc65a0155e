"""Mesh files copied beside a file that is written: named from there, each once, found again after a move."""

import shutil
from dataclasses import replace

import pytest
import trimesh

import ccpin
from ccpin.description import Shape, Visual, read_description
from ccpin.description.formats import write_description
from ccpin.errors import InvalidInputError

SUFFIXES = (".urdf", ".sdf", ".xml", ".yaml")


def drawn(folder):
    """A four-bar of which two links are drawn by different meshes of one name, and one by a mesh that is not there."""
    files = [folder / name / "bar.stl" for name in ("one", "two")]
    for k, file in enumerate(files):
        file.parent.mkdir(parents=True)
        trimesh.creation.box((0.1, 0.1, 0.5 + k)).export(file)
    meshes = [str(files[0]), str(files[1]), str(files[0]), str(folder / "lost.stl")]
    before = read_description("four_bar")
    links = (
        replace(link, visuals=(Visual(Shape("mesh", (1.0, 1.0, 1.0), mesh)),))
        for link, mesh in zip(before.links, meshes, strict=True)
    )
    return replace(before, links=tuple(links)), files


def found(description):
    """The mesh files of a description, by link."""
    return [shape.mesh for link in description.links for shape in (visual.shape for visual in link.visuals)]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_meshes_go_where_the_file_goes(suffix, tmp_path):
    """With the same bytes, under names that are relative; two of one name under two."""
    description, files = drawn(tmp_path / "cad")
    out = tmp_path / "out"
    out.mkdir()
    write_description(description, out / f"robot{suffix}", meshes="copied")
    assert sorted(path.name for path in (out / "meshes").iterdir()) == ["bar.stl", "bar_2.stl"]
    assert (out / "meshes" / "bar.stl").read_bytes() == files[0].read_bytes()
    assert (out / "meshes" / "bar_2.stl").read_bytes() == files[1].read_bytes()
    write_description(description, out / f"robot{suffix}", meshes="copied")  # again: nothing is copied twice
    assert len(list((out / "meshes").iterdir())) == 2
    text = (out / ("robot.urdf" if suffix == ".yaml" else f"robot{suffix}")).read_text()
    assert '"meshes/bar.stl"' in text or ">meshes/bar.stl<" in text
    assert str(files[0]) not in text
    shutil.rmtree(tmp_path / "cad")
    shutil.move(out, tmp_path / "moved")
    back = [name for name in found(read_description(tmp_path / "moved" / f"robot{suffix}")) if "lost" not in name]
    folder = tmp_path / "moved" / "meshes"
    assert back == [str(folder / name) for name in ("bar.stl", "bar_2.stl", "bar.stl")]


def test_mujoco_opens_the_copy(tmp_path):
    """From another folder than the one it was written from."""
    mujoco = pytest.importorskip("mujoco")
    description, _ = drawn(tmp_path / "cad")
    notes = write_description(description, tmp_path / "robot.xml", meshes="copied")
    assert any("lost.stl" in note for note in notes)
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml")).nmesh == 2


def test_kept_meshes_are_named_by_their_whole_path(tmp_path):
    """Which is the default of `save`; those below the file's folder need no copy."""
    description, files = drawn(tmp_path / "cad")
    write_description(description, tmp_path / "kept.urdf")
    assert str(files[0]) in (tmp_path / "kept.urdf").read_text()
    write_description(description, tmp_path / "near.urdf", meshes="copied")
    assert 'filename="cad/one/bar.stl"' in (tmp_path / "near.urdf").read_text()
    assert not (tmp_path / "meshes").exists()


def test_what_cannot_be_copied_is_told(tmp_path):
    """A file that stands where the folder should."""
    description, _ = drawn(tmp_path / "cad")
    out = tmp_path / "out"
    out.mkdir()
    (out / "meshes").write_text("")
    with pytest.raises(InvalidInputError, match=r"bar\.stl' cannot be copied beside"):
        write_description(description, out / "robot.urdf", meshes="copied")
    assert not (out / "robot.urdf").exists()
    assert ccpin.load(description).n == 1

"""Reading a file runs nothing and reads nothing but what is stated: xacro by name, meshes as geometry, no network."""

from __future__ import annotations

import socket

import pytest

import ccpin
from ccpin.description import read_description
from ccpin.description.elements.meshes import find_mesh
from ccpin.errors import DescriptionError
from ccpin.visualization.shapes import read_mesh
from tests.support.sdf_files import four_bar_urdf

URDF = four_bar_urdf()
MOUNT = '<joint name="mount" type="fixed"><parent link="ground"/><child link="m"/></joint>'
PREFIX = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
WRITES = "${[c for c in ().__class__.__base__.__subclasses__() if c.__name__ == 'catch_warnings'][0]()._module}"
REACHING = [
    WRITES,
    "${xacro.load_yaml.__globals__}",
    "${(lambda: ().__class__)()}",
    "${'%s'.format(1)}",
    "${python.type(1).mro()[1].__subclasses__()}",
    "$(eval arg._private)",
    "$(eval _eval_dict)",
]


def with_expression(expression):
    """The four-bar with an expression where a number stands."""
    return URDF.replace("<link", f'<link note="{expression.replace("<", "&lt;")}"', 1)


class TestXacro:
    """A program is run only where it is one by name or asked for."""

    @pytest.mark.parametrize("text", ["${1 + 1}", "$(arg x)", "$(find pkg)"])
    def test_a_urdf_with_expressions_is_refused_naming_the_option(self, tmp_path, text):
        """It was expanded, and could write to the disk."""
        path = tmp_path / "robot.urdf"
        path.write_text(with_expression(text))
        with pytest.raises(DescriptionError, match=r"robot\.urdf: .*\.xacro, or where xacro=True"):
            ccpin.load(path)

    def test_a_urdf_with_xacro_elements_is_refused(self, tmp_path):
        """Also where the prefix alone shows it."""
        path = tmp_path / "robot.urdf"
        path.write_text(URDF.replace("<link", '<xacro:property name="a" value="1"/><link', 1))
        with pytest.raises(DescriptionError, match="xacro=True"):
            read_description(path)

    def test_asked_for_it_is_expanded(self, tmp_path):
        """xacro=True, whatever the name."""
        pytest.importorskip("xacrodoc")
        path = tmp_path / "robot.urdf"
        path.write_text(with_expression("${1 + 1}"))
        assert ccpin.load(path, xacro=True).n == 1

    @pytest.mark.parametrize("expression", REACHING)
    def test_expressions_that_reach_behind_their_values_are_refused(self, tmp_path, expression):
        """In a .xacro file too; the evaluators are as they were afterwards."""
        xacro = pytest.importorskip("xacro")
        pytest.importorskip("xacrodoc")
        before = xacro.safe_eval
        path = tmp_path / "robot.urdf.xacro"
        path.write_text(with_expression(expression))
        with pytest.raises(DescriptionError, match="reaches behind"):
            read_description(path)
        assert xacro.safe_eval is before

    def test_a_condition_is_confined_too(self, tmp_path):
        """<xacro:if value=…> and property values are evaluated by the same functions."""
        pytest.importorskip("xacrodoc")
        path = tmp_path / "robot.urdf.xacro"
        element = '<xacro:if value="${().__class__ == 1}"><link name="x"/></xacro:if>'
        path.write_text(URDF.replace("<robot ", f"<robot {PREFIX} ").replace("<link", f"{element}<link", 1))
        with pytest.raises(DescriptionError, match="reaches behind"):
            read_description(path)


class TestMeshes:
    """A mesh is a mesh file, near the file that names it or where an absolute name says."""

    def test_only_mesh_files_are_found(self, tmp_path):
        """Not whatever else lies there."""
        source = str(tmp_path / "robot.urdf")
        for name in ("part.stl", "notes.txt", "key"):
            (tmp_path / name).write_text("solid a\nendsolid a\n")
        assert find_mesh("part.stl", source) == (tmp_path / "part.stl").resolve()
        assert find_mesh("notes.txt", source) is None
        assert find_mesh(f"file://{tmp_path}/key", source) is None
        assert "no regular file of one of the kinds drawn" in read_mesh(str(tmp_path / "notes.txt"))

    def test_a_relative_name_does_not_climb_out(self, tmp_path):
        """Four folders above the file is as far as it goes, however many dots are written."""
        deep = tmp_path.joinpath(*"abcdef")
        deep.mkdir(parents=True)
        (tmp_path / "outside.stl").write_text("solid a\nendsolid a\n")
        (tmp_path / "a" / "b" / "inside.stl").write_text("solid a\nendsolid a\n")
        source = str(deep / "robot.urdf")
        assert find_mesh("../../../../inside.stl", source) is not None
        assert find_mesh("../" * 6 + "outside.stl", source) is None
        assert find_mesh("package://x/" + "../" * 7 + "outside.stl", source) is None

    def test_nothing_is_fetched(self, tmp_path, monkeypatch):
        """An address is a name of no file."""
        monkeypatch.setattr(socket, "socket", lambda *_, **__: pytest.fail("a connection was tried"))
        source = tmp_path / "robot.urdf"
        for name in ("http://localhost/a.stl", "https://example.org/a.stl", "ftp://example.org/a.stl"):
            visual = f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
            source.write_text(URDF.replace("</robot>", f'<link name="m">{visual}</link>{MOUNT}</robot>'))
            assert find_mesh(name, str(source)) is None
            assert any(name in note for note in read_description(source).notes)

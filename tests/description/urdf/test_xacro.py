"""xacro files through xacrodoc: macros, includes, arguments; a clear word where the extra is missing."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import ccpin
from ccpin.cli import main
from ccpin.description import read_description
from ccpin.errors import DescriptionError
from tests.support.damage import TEXT_XML_DAMAGE, complaints
from tests.support.long_cases import later
from tests.support.reading import read_urdf
from tests.support.sdf_files import COUPLER, four_bar_urdf

URDF = four_bar_urdf()
XACRO = (
    URDF.replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ')
    .replace(
        "<joint", '<xacro:arg name="length" default="0.1"/><xacro:include filename="parts/lengths.xacro"/><joint', 1
    )
    .replace(f'xyz="{COUPLER} 0 0"', 'xyz="${coupler + 0 * length} 0 0"')
)


@pytest.fixture
def file(tmp_path):
    """The four-bar with its coupler's length in an included file."""
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "lengths.xacro").write_text(
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:property name="length" value="$(arg length)"/>'
        f'<xacro:property name="coupler" value="{COUPLER}"/></robot>'
    )
    path = tmp_path / "bars.urdf.xacro"
    path.write_text(XACRO)
    return path


def test_without_the_extra_the_error_names_it(file, monkeypatch):
    """pip install 'ccpin[xacro]'."""
    monkeypatch.setitem(sys.modules, "xacrodoc", None)
    with pytest.raises(DescriptionError, match=r"bars\.urdf\.xacro: .*ccpin\[xacro\]"):
        read_description(file)


def test_a_urdf_that_only_declares_the_prefix_needs_no_xacro(tmp_path, monkeypatch):
    """xmlns:xacro is left in many an expanded file."""
    monkeypatch.setitem(sys.modules, "xacrodoc", None)
    path = tmp_path / "plain.urdf"
    path.write_text(URDF.replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" '))
    assert ccpin.load(path).n == 1


class TestExpanded:
    """What needs xacrodoc."""

    @pytest.fixture(autouse=True)
    def _needs_xacrodoc(self):
        pytest.importorskip("xacrodoc")

    def test_equals_the_urdf(self, file, capfd, monkeypatch):
        """From any working folder, twice, without a word printed."""
        monkeypatch.chdir(file.parent.parent)
        twin = read_urdf(URDF.encode(), None)
        for _ in range(2):
            description = read_description(file)
            assert description.name == twin.name
            for ours, theirs in zip(description.closures, twin.closures, strict=True):
                assert np.array_equal(ours.placement_a, theirs.placement_a)
        assert capfd.readouterr() == ("", "")

    def test_arguments_reach_it(self, file, capsys):
        """In Python and on the command line."""
        file.write_text(XACRO.replace("0 * length", "length"))
        longer = read_description(file, xacro_arguments={"length": "0.05"}).closures[0]
        assert np.isclose(longer.placement_a[0, 3], COUPLER + 0.05)
        assert main(["info", str(file), "--xacro-arg", "length:=0.0"]) == 0
        assert main(["info", str(file), "--xacro-arg", "length"]) == 1
        assert "name:=value" in capsys.readouterr().err

    @pytest.mark.parametrize(
        ("before", "after"),
        [
            ("lengths.xacro", "absent.xacro"),
            ("${coupler", "${unknown"),
            ("${coupler", "${1/0"),
            ("$(", "$(find nothing)$("),
        ],
    )
    def test_what_xacro_refuses_is_told_with_the_file(self, file, before, after):
        """Never a foreign exception."""
        text = XACRO if before in XACRO else XACRO.replace("<joint", '<joint note="$(arg length)"', 1)
        file.write_text(text.replace(before, after))
        with pytest.raises(DescriptionError, match=r"bars\.urdf\.xacro: xacro: cannot expand the file"):
            read_description(file)

    @pytest.mark.parametrize("seeds", later(range(50), range(50, 200)), ids=len)
    def test_a_damaged_file_loads_or_is_refused_by_name(self, seeds, tmp_path, capfd):
        """Macros, conditions and properties, damaged."""
        text = XACRO.replace(
            '<xacro:include filename="parts/lengths.xacro"/>',
            f'<xacro:property name="coupler" value="{COUPLER}"/><xacro:property name="length" value="$(arg length)"/>'
            '<xacro:macro name="extra" params="a b:=1"><link name="${a}"/></xacro:macro><xacro:extra a="tip"/>'
            '<joint name="mount" type="fixed"><parent link="ground"/><child link="tip"/></joint>'
            '<xacro:if value="${length &lt; 0}"><link name="never"/></xacro:if>',
        )
        assert not complaints({"x": text}, seeds, tmp_path, TEXT_XML_DAMAGE, ".xacro")
        assert capfd.readouterr() == ("", "")

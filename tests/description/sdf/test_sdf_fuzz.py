"""Damaged SDFormat files: each loads or is refused with its file and the element at fault, in good time."""

import pytest

import ccpin
from tests.support.damage import TEXT_XML_DAMAGE, complaints
from tests.support.described import SDF_TEXTS
from tests.support.long_cases import later


@pytest.mark.parametrize("chunk", later(*range(4)))
def test_a_damaged_file_loads_or_is_refused_by_name(chunk, tmp_path, capfd):
    """A few hundred cases."""
    assert not complaints(SDF_TEXTS, range(chunk, 300, 4), tmp_path, TEXT_XML_DAMAGE, ".sdf")
    printed = capfd.readouterr()
    assert (printed.out, printed.err) == ("", "")


@pytest.mark.slow
def test_two_thousand_damaged_files(tmp_path):
    """The rest of two thousand."""
    assert not complaints(SDF_TEXTS, range(300, 2300), tmp_path, TEXT_XML_DAMAGE, ".sdf")


@pytest.mark.parametrize("name", sorted(SDF_TEXTS))
def test_the_undamaged_originals_load(name, tmp_path):
    """The damage is what is refused."""
    file = tmp_path / "m.sdf"
    file.write_text(SDF_TEXTS[name])
    assert ccpin.load(file).n >= 1

"""Results that come back damaged are refused by name, or are what they were; and what is hostile costs no memory.

The slow campaign is of 600 files a kind: ``pytest -m slow tests/test_damaged_documents.py``, or as many as
``CCPIN_DAMAGED`` says.
"""

import contextlib
import io
import json
import os
import struct
import tracemalloc
import zipfile
from typing import NamedTuple

import numpy as np
import pytest

import ccpin
from ccpin import containers
from ccpin.domain import Atlas, SheetAtlas, SingularCover, certify, certify_sheets, certify_singularities
from ccpin.domain.closures.packing import fingerprint
from ccpin.errors import CcpinError, InvalidInputError
from tests.support.damage import TooSlow, time_limit
from tests.support.damaged import altered, bytes_of, damaged, parts_of
from tests.support.long_cases import later
from tests.support.paper import START

DAMAGED = int(os.environ.get("CCPIN_DAMAGED", "600"))
WINDOW = ((-2.0, -1.5), (-1.8, -1.2))
MOST = 64e6


class Kind(NamedTuple):
    """How a kind of document is made and read."""

    make: object
    load: object
    suffix: str


def _motion():
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    return ccpin.simulate(model, None, START, duration=0.02)


KINDS = {
    "atlas.npz": Kind(lambda: certify(ccpin.load("rpdr"), (-1.885, -1.257), WINDOW, max_depth=2), Atlas.load, ".npz"),
    "atlas.json": Kind(lambda: certify(ccpin.load("rpdr"), (-1.885, -1.257), WINDOW, max_depth=2), Atlas.load, ".json"),
    "sheets.npz": Kind(lambda: certify_sheets(ccpin.load("rpdr"), WINDOW, max_depth=2), SheetAtlas.load, ".npz"),
    "sheets.json": Kind(lambda: certify_sheets(ccpin.load("rpdr"), WINDOW, max_depth=2), SheetAtlas.load, ".json"),
    "curves.npz": Kind(
        lambda: certify_singularities(ccpin.load("rpdr"), ((0.9, 2.2), (1.0, 2.3))), SingularCover.load, ".npz"
    ),
    "curves.json": Kind(
        lambda: certify_singularities(ccpin.load("rpdr"), ((0.9, 2.2), (1.0, 2.3))), SingularCover.load, ".json"
    ),
    "motion.npz": Kind(_motion, ccpin.Trajectory.load, ".npz"),
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The bytes of an undamaged file of each kind."""
    folder = tmp_path_factory.mktemp("whole")
    for name, kind in KINDS.items():
        kind.make().save(folder / name)
    certify(ccpin.load("rpdr"), (-1.885, -1.257), ((-2.6, -2.0), (-1.3, -0.9)), max_depth=3).save(folder / "split.npz")
    return {name: (folder / name).read_bytes() for name in (*KINDS, "split.npz")}


def complaints(name, whole, numbers, folder):
    """What is wrong with how damaged files of a kind are taken, a line each."""
    kind, found = KINDS[name], []
    path = folder / f"damaged{kind.suffix}"
    said = parts_of(whole)
    for number in numbers:
        data, how = damaged(whole, np.random.default_rng(number))
        path.write_bytes(data)
        try:
            result = kind.load(path)
        except CcpinError as error:
            if str(path) not in str(error):
                found.append(f"{number} ({how}): no file named: {error}")
            continue
        except Exception as error:
            found.append(f"{number} ({how}): leaked {type(error).__name__}: {error}")
            continue
        again = folder / f"again{kind.suffix}"
        result.save(again)
        if not _same(parts_of(again.read_bytes()), said):
            found.append(f"{number} ({how}): accepted, and not what it was")
    return found


def _same(one, other):
    (header, arrays), (header_two, arrays_two) = one, other
    same = header == header_two and {*arrays} == {*arrays_two}
    return same and all(np.array_equal(arrays[name], arrays_two[name]) for name in arrays)


@pytest.mark.parametrize("name", KINDS)
def test_damaged_files_are_refused_by_name_or_are_what_they_were(name, whole, tmp_path):
    """A small sample of each kind: nothing of numpy's, zipfile's or Python's own gets out."""
    assert complaints(name, whole[name], range(20), tmp_path) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_many_damaged_files(name, whole, tmp_path):
    """The same of as many as are asked for."""
    assert complaints(name, whole[name], range(1000, 1000 + DAMAGED), tmp_path) == []


def leaks(name, whole, numbers, folder):
    """As `complaints`, where checksum and fingerprint are made right again: anything may load, nothing may leak."""
    kind, found = KINDS[name], []
    path = folder / f"altered{kind.suffix}"
    for number in numbers:
        data, how = altered(whole, np.random.default_rng(number), _restamped)
        path.write_bytes(data)
        try:
            with time_limit():
                kind.load(path)
        except CcpinError as error:
            if str(path) not in str(error):
                found.append(f"{number} ({how}): no file named: {error}")
        except TooSlow:
            found.append(f"{number} ({how}): too slow")
        except Exception as error:
            found.append(f"{number} ({how}): leaked {type(error).__name__}: {error}")
    return found


def _restamped(header, arrays):
    with contextlib.suppress(ValueError, TypeError, RuntimeWarning):
        if "fingerprint" in header:
            header["fingerprint"] = fingerprint(arrays)
        header["checksum"] = containers.checksum(header, arrays)


@pytest.mark.parametrize("numbers", later(range(8), range(8, 20)), ids=["few", "more"])
@pytest.mark.parametrize("name", KINDS)
def test_altered_files_leak_no_error(name, numbers, whole, tmp_path):
    """A small sample of what no checksum tells."""
    assert leaks(name, whole[name], numbers, tmp_path) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_many_altered_files(name, whole, tmp_path):
    """The same of as many as are asked for."""
    assert leaks(name, whole[name], range(1000, 1000 + DAMAGED), tmp_path) == []


def _changed(whole, name, path, change):
    """A document whose arrays and header were changed and whose checksum is right again."""
    header, arrays = parts_of(whole[name])
    change(header, arrays)
    header["checksum"] = containers.checksum(header, arrays)
    path.write_bytes(bytes_of(header, arrays, path.suffix == ".json"))
    return path


@pytest.mark.parametrize(
    ("field", "value", "told"),
    [
        ("tree_child", 0, "tree_child"),
        ("tree_child", 10**6, "tree_child"),
        ("tree_lower", 5, "tree"),
        ("tree_box", 10**6, "tree_box"),
        ("tree_status", 5, "tree_status"),
        ("chain0_tip", 1e300, "chain0_tip"),
        ("chain0_axes", 2.0, "chain0_axes"),
        ("system_dependent", 0, "system_"),
        ("box_centre", np.nan, "box_centre"),
        ("lower", np.inf, "lower"),
        ("wrapped", True, "wrapped"),
    ],
)
def test_what_contradicts_itself_is_refused_by_field(field, value, told, whole, tmp_path):
    """One number, with the checksum right: a tree that goes in circles, a box that is none."""

    def change(header, arrays):
        arrays[field] = arrays[field].copy()
        if arrays[field].size:
            arrays[field].reshape(-1)[0] = value
        else:
            arrays[field] = np.full((1, *arrays[field].shape[1:]), value, arrays[field].dtype)
        header["fingerprint"] = fingerprint(arrays)

    path = _changed(whole, "atlas.npz", tmp_path / "changed.npz", change)
    with pytest.raises(InvalidInputError, match=told) as raised:
        Atlas.load(path)
    assert str(path) in str(raised.value)


def test_arrays_and_fields_that_nothing_reads_are_refused(whole, tmp_path):
    """An array or a field of the header that is not declared."""
    path = _changed(whole, "atlas.npz", tmp_path / "a.npz", lambda _, arrays: arrays.update(more=np.zeros(3)))
    with pytest.raises(InvalidInputError, match="more"):
        Atlas.load(path)
    path = _changed(whole, "atlas.npz", tmp_path / "b.npz", lambda header, _: header.update(more=1))
    with pytest.raises(InvalidInputError, match="more"):
        Atlas.load(path)


@pytest.mark.parametrize("name", KINDS)
def test_older_formats_are_told_with_the_one_wanted(name, whole, tmp_path):
    """The format found and the one that is read, both."""
    wanted = parts_of(whole[name])[0]["format"]
    path = tmp_path / f"old{KINDS[name].suffix}"
    _changed(whole, name, path, lambda header, _: header.update(format=f"{wanted[:-1]}0"))
    with pytest.raises(InvalidInputError, match=f"the format is '{wanted[:-1]}0', not '{wanted}'"):
        KINDS[name].load(path)


def test_a_trajectory_of_before_formats_is_told(tmp_path):
    """What was saved compressed and without a header."""
    np.savez_compressed(tmp_path / "old.npz", t=np.zeros(3), q=np.zeros((3, 2)))
    with pytest.raises(InvalidInputError, match="an older format"):
        ccpin.Trajectory.load(tmp_path / "old.npz")


def _npy(dtype, shape, data=b""):
    head = f"{{'descr': {dtype!r}, 'fortran_order': False, 'shape': {shape!r}, }}".encode()
    head += b" " * (-(len(head) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + data


HOSTILE = {
    "an element of 1 GB": _npy("|S1000000000", (4,)),
    "a void of 2 GB": _npy("|V2000000000", (1,)),
    "text": _npy("<U32", (1,), b"\0" * 128),
    "objects": _npy("|O", (1,), b"\x80\x04N."),
    "1e12 numbers": _npy("<f8", (10**12,)),
    "numbers less than none": _npy("<f8", (-1, -8), b"\0" * 64),
    "a header that is deep": b"\x93NUMPY\x01\x00" + struct.pack("<H", 60_000) + b"(" * 60_000,
}


def _refused_in_little_memory(path, load=Atlas.load):
    tracemalloc.start()
    try:
        with pytest.raises(InvalidInputError) as raised:
            load(path)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert str(path) in str(raised.value)
    assert most < MOST


@pytest.mark.parametrize("what", HOSTILE)
def test_sizes_are_checked_before_memory_is_taken(what, whole, tmp_path):
    """One array of an atlas says that it is something else."""
    stream = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(whole["atlas.npz"])) as old, zipfile.ZipFile(stream, "w") as new:
        for member in old.infolist():
            new.writestr(member.filename, HOSTILE[what] if member.filename == "q0.npy" else old.read(member))
    path = tmp_path / "hostile.npz"
    path.write_bytes(stream.getvalue())
    _refused_in_little_memory(path)


@pytest.mark.parametrize("method", [zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2])
def test_a_bomb_is_not_unpacked(method, tmp_path):
    """A file of some kilobytes that unpacks to eighty megabytes, in an array nobody asks for."""
    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(path, "w", method) as archive:
        archive.writestr("bomb.npy", b"\0" * 80_000_000)
    _refused_in_little_memory(path)
    _refused_in_little_memory(path, ccpin.Trajectory.load)


def test_encrypted_and_unknown_members_are_refused(whole, tmp_path):
    """Bits of the archive's own headers that Python's zipfile has errors of its own for."""
    data = bytearray(whole["atlas.npz"])
    for at, value in ((data.rfind(b"PK\x01\x02") + 8, 1), (data.rfind(b"PK\x01\x02") + 10, 77)):
        spoilt = bytearray(data)
        spoilt[at] = value
        (tmp_path / "a.npz").write_bytes(spoilt)
        with pytest.raises(InvalidInputError, match=r"a\.npz"):
            Atlas.load(tmp_path / "a.npz")


@pytest.mark.parametrize(
    "text", ["[" * 500_000, '{"a":' * 500_000, '{"format": NaN}', '{"arrays": []}', "[]", "1" * 9999]
)
def test_json_that_is_no_document(text, tmp_path):
    """Deep, not an object, or with what is no number: no RecursionError."""
    (tmp_path / "a.json").write_text(text)
    _refused_in_little_memory(tmp_path / "a.json")


def test_a_folder_or_nothing_is_refused(tmp_path):
    """Where there is no file to read."""
    for path in (tmp_path, tmp_path / "absent.npz", tmp_path / "absent.json", "a\0b.npz"):
        with pytest.raises(InvalidInputError):
            Atlas.load(path)
        with pytest.raises(InvalidInputError):
            ccpin.Trajectory.load(path)


@pytest.mark.parametrize("suffix", [".npz", ".json"])
def test_documents_come_back_bit_for_bit(suffix, whole, tmp_path):
    """What is read and written again is the same file's contents."""
    atlas = Atlas.load(_written(whole["atlas.npz"], tmp_path / "a.npz"))
    atlas.save(tmp_path / f"b{suffix}")
    again = parts_of((tmp_path / f"b{suffix}").read_bytes())
    assert _same(again, parts_of(whole["atlas.npz"]))
    assert json.dumps(again[0])


def _written(data, path):
    path.write_bytes(data)
    return path


def test_what_is_loaded_says_that_it_rests_on_its_file(whole, tmp_path):
    """A verdict that was read, not proved here; also of what is merged from it. Continued or replayed it is proved."""
    path = _written(whole["curves.npz"], tmp_path / "curves.npz")
    cover = SingularCover.load(path)
    assert str(path) in cover.reason
    assert "loaded" in repr(cover)
    made = KINDS["atlas.npz"].make()
    assert made.source is None
    assert "verify" not in made.reason
    atlas = Atlas.load(_written(whole["atlas.npz"], tmp_path / "atlas.npz"))
    assert atlas.verdict == made.verdict
    assert atlas.reason.startswith(made.reason)
    assert "ccpin verify" in atlas.reason
    assert str(path) in ccpin.domain.merge([cover]).reason
    for again in (cover.continued(), SingularCover.load(path, replay=True)):
        assert again.verdict == cover.verdict == "proven"
        assert again.source == str(path)
        assert str(path) not in again.reason


def test_a_box_over_another_cell_is_refused(whole, tmp_path):
    """The cells of two boxes exchanged: each is proved, and certifies a cell that it does not lie over."""

    def change(header, arrays):
        cells = np.flatnonzero(arrays["tree_box"] >= 0)[:2]
        arrays["tree_box"][cells] = arrays["tree_box"][cells[::-1]]

    with pytest.raises(InvalidInputError, match="does not cover its cell"):
        Atlas.load(_changed(whole, "split.npz", tmp_path / "a.npz", change))

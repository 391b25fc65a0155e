"""Files made to harm whoever reads them: refused by name, in time and memory that their size bounds."""

import io
import json
import resource
import struct
import zipfile

import numpy as np
import pytest

import ccpin
from ccpin.cli import main
from ccpin.domain import certify
from ccpin.errors import InvalidInputError

pytest.importorskip("flint")

from ccpin.auditing import declared, verify
from ccpin.domain.documents.kinds import ATLAS, CURVES, SHEETS


@pytest.fixture(scope="module")
def honest(tmp_path_factory):
    """A four-bar's atlas as an npz file and a JSON file."""
    folder = tmp_path_factory.mktemp("hostile")
    atlas = certify(ccpin.load("four_bar"), (0.7,), max_depth=2)
    for suffix in ("npz", "json"):
        atlas.save(folder / f"atlas.{suffix}")
    return folder


def npy(descr, shape, data=b""):
    """An .npy member whose header says what it likes."""
    header = repr({"descr": descr, "fortran_order": False, "shape": shape}).encode()
    header += b" " * (-(len(header) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + data


def rewritten(honest, tmp_path, replace, compression=zipfile.ZIP_STORED):
    """The npz file with some members' bytes replaced or added."""
    path = tmp_path / "hostile.npz"
    with zipfile.ZipFile(honest / "atlas.npz") as old, zipfile.ZipFile(path, "w", compression) as new:
        for name in old.namelist():
            new.writestr(name, replace.pop(name, None) or old.read(name))
        for name, data in replace.items():
            new.writestr(name, data)
    return path


@pytest.mark.parametrize(
    ("descr", "shape"),
    [
        ("|S1000000000", (4,)),
        ("|O", (1,)),
        ("<U32", (1,)),
        ("|V2000000000", (1,)),
        ("<f8", (10**12,)),
        ("<f8", (10**6, 10**6)),
        ("<f8", (-1,)),
        ("<c16", (1,)),
        (">f8", (1,)),
        ("<f4", (1,)),
        ([("a", "<f8")], (1,)),
        ("nonsense", (1,)),
    ],
)
def test_headers_of_arrays_are_read_before_their_numbers(honest, tmp_path, descr, shape):
    """Dtypes that no certificate has, and shapes that take up more than there is."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for name in ("upper.npy", "nobody_asks.npy"):
        with pytest.raises(InvalidInputError, match=rf"hostile\.npz: '{name[:-4]}'"):
            verify(rewritten(honest, tmp_path, {name: npy(descr, shape, b"\0" * 8)}))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kB


def test_members_that_unpack_to_more_than_the_file_are_refused(honest, tmp_path):
    """Compressed members, of which two megabytes may be two gigabytes."""
    big = npy("<f8", (10**6,), b"\0" * 8 * 10**6)
    path = rewritten(honest, tmp_path, {"nobody_asks.npy": big}, zipfile.ZIP_DEFLATED)
    assert path.stat().st_size < 200_000
    with pytest.raises(InvalidInputError, match="compressed"):
        verify(path)


@pytest.mark.parametrize("flags", [{"method": 97}, {"encrypted": 1}, {"size": 2**31}])
def test_members_of_other_kinds_are_refused(honest, tmp_path, flags):
    """Unknown compression, encryption, and a size that is not true."""
    data = bytearray((honest / "atlas.npz").read_bytes())
    at = data.index(b"PK\x01\x02")
    if "method" in flags:
        data[at + 10 : at + 12] = struct.pack("<H", flags["method"])
    if "encrypted" in flags:
        data[at + 8] |= 1
    if "size" in flags:
        data[at + 24 : at + 28] = struct.pack("<I", flags["size"])
    (tmp_path / "hostile.npz").write_bytes(data)
    with pytest.raises(InvalidInputError, match=r"hostile\.npz"):
        verify(tmp_path / "hostile.npz")


def test_a_member_that_stands_twice_is_refused(honest, tmp_path):
    path = tmp_path / "hostile.npz"
    path.write_bytes((honest / "atlas.npz").read_bytes())
    buffer = io.BytesIO()
    np.save(buffer, np.zeros(1))
    with zipfile.ZipFile(path, "a") as file, pytest.warns(UserWarning, match="Duplicate"):
        file.writestr("upper.npy", buffer.getvalue())
    with pytest.raises(InvalidInputError, match="twice"):
        verify(path)


@pytest.mark.parametrize(
    "text",
    [
        "[" * 200_000,
        '{"a":' * 200_000,
        '{"arrays": {"lower": {"dtype": "float64", "shape": [1e400], "data": []}}}',
        '{"arrays": {"lower": {"dtype": "float64", "shape": [1000000000000], "data": []}}}',
        '{"arrays": {"lower": {"dtype": "S1000000000", "shape": [1], "data": [0]}}}',
        '{"arrays": {"lower": {"dtype": "float64", "shape": [1], "data": [NaN]}}}',
        '{"arrays": {"lower": {"dtype": "float64", "shape": [1], "data": ["1"]}}}',
        '{"arrays": {"lower": {"dtype": "float64", "shape": [1], "data": [1e400]}}}',
        '{"arrays": {"lower": {"dtype": "int64", "shape": [1], "data": [99999999999999999999]}}}',
        '{"arrays": {"lower": {"dtype": "float64", "shape": [1], "data": [' + "9" * 400 + "]}}}",
        '{"arrays": {"lower": {"dtype": "float64", "shape": [1], "data": [' + "9" * 6000 + "]}}}",
        '{"arrays": {"lower": []}}',
        '{"arrays": [], "format": "ccpin-atlas-5"}',
        '{"arrays": {}, "format": ["ccpin-atlas-5"]}',
        "\ud800",
    ],
)
def test_json_that_is_no_document_is_refused(tmp_path, text):
    """Nested too deeply, of other dtypes, with numbers that are none, or too large."""
    (tmp_path / "hostile.json").write_text(text, encoding="utf-8", errors="surrogatepass")
    with pytest.raises(InvalidInputError, match=r"hostile\.json"):
        verify(tmp_path / "hostile.json")


def test_the_command_says_it_in_one_line(honest, tmp_path, capsys):
    """No traceback; other than what is undecided or refuted."""
    path = rewritten(honest, tmp_path, {"upper.npy": npy("|O", (1,), b"\0" * 8)})
    assert main(["verify", str(path)]) == 1
    assert "upper.npy: the dtype is object" in capsys.readouterr().err


def test_every_field_set_to_anything_is_refused_by_name(honest, tmp_path):
    """Each field of the header in turn: what it cannot be is named."""
    whole = json.loads((honest / "atlas.json").read_text())
    for name in [name for name in whole if name != "arrays"]:
        for value in (None, -1, [[]], {"a": 1}, 1e300, "\0"):
            if name in ("theorem", "fingerprint", "checksum", "format") and isinstance(value, str):
                continue
            (tmp_path / "hostile.json").write_text(json.dumps(whole | {name: value}))
            with pytest.raises(InvalidInputError, match=rf"hostile\.json: .*({name}|format)"):
                verify(tmp_path / "hostile.json", sample=1)


def test_the_auditor_and_the_writers_declare_the_same_arrays():
    """Two declarations, made apart: the same names, kinds of numbers and shapes."""
    for kind in (ATLAS, SHEETS, CURVES):
        schema, theirs = kind.schema, declared._SYSTEM | declared._OF[kind.schema.format]
        ours = {
            name: " ".join([field.kind.replace("s", "i"), *field.sizes("")]) for name, field in schema.fields.items()
        }
        assert ours == theirs

"""Programs that refuse what is outside their certified region: in NumPy, C, lanes, as JSON, and in other libraries."""

import json
import pickle
import subprocess
from contextlib import suppress
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import ccpin
from ccpin import programs
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.programs import program as program_module
from ccpin.programs.bridges.differentiated import evaluated, parts_of
from ccpin.programs.c_self_test import states
from ccpin.programs.certified_region import OUTSIDE, CertifiedRegion
from ccpin.programs.compiling import NoCompilerError
from ccpin.programs.lanes import CompiledProgram
from ccpin.programs.same_bits import c_answers
from ccpin.programs.sine_cosine import PRECISIONS
from ccpin.validated import certify_program
from tests.support.exported import compiler, exported, self_tested
from tests.support.programs import on_branch

pytest.importorskip("flint")
FORMATS = pytest.mark.parametrize("format", ["double", "float"])
HALF = 0.1


@pytest.fixture(scope="module")
def certificate():
    """Of the slider crank's σ and q̈, found from near by."""
    model = ccpin.ReducedModel(ccpin.load("slider_crank"))
    program = programs.record(model, ("sigma", "forward_dynamics"), given="near")
    middle = np.array(program.example[:1])
    bounds = {"v": 1.0, "u": 0.1}  # of which no format has the second
    found = certify_program(program, (middle - HALF, middle + HALF), bounds=bounds, max_cells=16)
    assert found.verdict == "proven"
    return found


def named(program, rows):
    """Rows of all inputs, by their ports' names."""
    ends = np.cumsum([port.size for port in program.inputs])[:-1]
    return dict(zip([port.name for port in program.inputs], np.split(rows, ends, axis=1), strict=True))


def hostile(program, format):
    """Rows about the region's ends, and which are in it: numbers of the format next to each end, and no number."""
    kind, region = PRECISIONS[format].type, program.region
    first, rows, inside = np.array(program.example, dtype=kind), [], []
    for k, ends in enumerate(zip(region.lower, region.upper, strict=True)):
        near = [np.nextafter(kind(end), kind(way)) for end in ends for way in (-np.inf, np.inf)]
        for value in (*map(kind, ends), *near, kind(np.nan), kind(np.inf), kind(-np.inf)):
            row = first.copy()
            row[k] = value
            rows.append(row)
            inside.append(bool(ends[0] <= float(value) <= ends[1]))
    return np.array(rows), np.array(inside)


@FORMATS
def test_status_is_3_outside_and_nowhere_else(certificate, format, tmp_path):
    """NumPy, exported C and lanes, at the numbers next to every end, and where there is no number."""
    program = certificate.guarded()
    rows, inside = hostile(program, format)
    assert inside.any()
    assert not inside.all()
    ways = [c_answers(program, rows, PRECISIONS[format]).status, exported(program, tmp_path, format)(rows)[1]]
    if format == "double":
        ways.append(program(**named(program, rows)).status)
    with suppress(NoCompilerError):
        ways.append(CompiledProgram(program, format)(*named(program, rows).values())[-1])
    for status in ways:
        np.testing.assert_array_equal(np.asarray(status) != OUTSIDE, inside)


@FORMATS
def test_the_written_test_looks_on_both_sides(certificate, format, tmp_path):
    """States in the region, which are trusted; of every input two beyond its ends, and no number; to the last bit."""
    program = certificate.guarded()
    rows = states(program, PRECISIONS[format])
    status = c_answers(program, rows, PRECISIONS[format]).status.tolist()
    size, inner = len(program.example), 1 + len(program.around)
    assert status == [0] * inner + [OUTSIDE] * (3 * size)
    said = self_tested(program, tmp_path, format, "kept")
    assert said == f"kept: 0 of {len(rows)} states wrong, {len(rows)} the same to the last bit\n"
    header = (tmp_path / "kept.h").read_text()
    for line in certificate.statement().splitlines():
        assert line in header
    assert "kept_OUTSIDE = 3" in header
    test = tmp_path / "kept_test.c"
    other = header.replace(">= (low)", "> (low) - 1")
    assert other != header
    (tmp_path / "kept.h").write_text(other)
    subprocess.run([compiler(), "-O1", str(test), "-o", str(tmp_path / "t"), "-lm"], check=True)
    assert subprocess.run([str(tmp_path / "t")], capture_output=True, check=False).returncode == 1


def test_inputs_of_the_region_are_what_they_were(certificate):
    """Of y within `start` of the branch nothing is refused, and outputs are those of the program without a region."""
    program, rng = certificate.guarded(), np.random.default_rng(0)
    q = rng.uniform(certificate.lower, certificate.upper, (300, 1))
    y = on_branch(certificate, q)
    y = y + rng.choice((-1.0, 1.0), y.shape) * certificate.start
    rest = certificate.bounds * rng.choice((-1.0, 1.0), (300, len(certificate.bounds)))
    given = named(program, np.hstack([q, y, rest]))
    found, plain = program(**given), certificate.program(**given)
    np.testing.assert_array_equal(found.status, 0)
    for name in plain:
        np.testing.assert_array_equal(found[name], plain[name])
    wide = np.array(program.region.upper[1:3]) - np.array(program.region.lower[1:3])
    far = y.max(axis=0) - y.min(axis=0)
    assert (far <= wide).all()
    assert (wide <= 1.5 * far).all()


def test_other_libraries_see_no_number_outside(certificate):
    """What CasADi, JAX and PyTorch evaluate is not trusted there."""
    program = parts_of(certificate.guarded()).values
    rows, inside = hostile(program, "double")
    module = SimpleNamespace(sin=np.sin, cos=np.cos, abs=np.abs, both=np.logical_and, true=True)
    with np.errstate(invalid="ignore"):
        _, trusted = evaluated(program, list(rows.T), module)
    assert not np.any(trusted & ~inside)
    assert trusted[inside].any()


def test_json_keeps_the_region(certificate, tmp_path):
    program = certificate.guarded()
    (path,) = programs.export(program, tmp_path, "json", name="kept")
    again = programs.Program.load(path)
    assert again.region == program.region
    assert again.digest == program.digest != certificate.program.digest
    assert pickle.loads(pickle.dumps(program)).region == program.region
    rows, inside = hostile(program, "double")
    np.testing.assert_array_equal(again(**named(program, rows)).status != OUTSIDE, inside)


CHANGES = {
    "none": lambda region: region.clear(),
    "wider": lambda region: region.update(upper=[(9.0).hex()] * len(region["upper"])),
    "another statement": lambda region: region.update(statement="Proved everywhere."),
    "no number": lambda region: region["lower"].__setitem__(0, "nan"),
    "no end": lambda region: region["upper"].__setitem__(0, "inf"),
    "fewer": lambda region: region["lower"].pop(),
    "reversed": lambda region: region.update(lower=region["upper"], upper=region["lower"]),
    "fewer of both": lambda region: [region[name].pop() for name in ("lower", "upper")],
    "one reversed": lambda region: region["lower"].__setitem__(0, (1.2 * float.fromhex(region["upper"][0])).hex()),
    "a format that is none beside one": lambda region: region.update(formats=["double", "half"]),
    "a format that is no word": lambda region: region.update(formats=[["double"]]),
    "no format": lambda region: region.update(formats=[]),
    "a format that is none": lambda region: region.update(formats=["half"]),
    "a list for a text": lambda region: region.update(statement=["Proved."]),
}


@pytest.mark.parametrize("way", CHANGES)
def test_a_changed_region_is_refused(certificate, way, tmp_path):
    document = json.loads(certificate.guarded().text)
    document.pop("digest")
    CHANGES[way](document["region"])
    digest = "" if way in ("wider", "another statement") else program_module._digest(document)
    (tmp_path / "p.json").write_text(json.dumps(document | {"digest": digest}))
    with pytest.raises(CcpinError, match=r"p\.json"):
        programs.Program.load(tmp_path / "p.json")


def test_what_is_not_proved_is_no_region(certificate, tmp_path):
    """Undecided, pickled, of another program's facts, in another format; and certified once more with its region."""
    for other in (
        pickle.loads(pickle.dumps(certificate)),
        replace(certificate, computed=()),
        replace(certificate, upper=certificate.upper + 1e-9),
        replace(certificate, program=certificate.guarded()),
    ):
        with pytest.raises(InvalidInputError, match="no region is certified"):
            other.guarded()
    double = replace(certificate, computed=certificate.computed[:1]).guarded()
    assert double.region.formats == ("double",)
    with pytest.raises(InvalidInputError, match="of double, not of float"):
        programs.export(double, tmp_path, format="float")
    with pytest.raises(InvalidInputError, match="of double, not of float"):
        CompiledProgram(double, "float")
    box = (certificate.lower, certificate.upper)
    with pytest.raises(InvalidInputError, match="certified region"):
        certify_program(double, box, bounds={"v": 1.0, "u": 0.1})
    assert not list(tmp_path.iterdir())


def test_ends_in_a_format_are_within(certificate):
    """Whatever they are: 0.1, 0, the least number, more than float has."""
    region = CertifiedRegion((0.1, -0.0, 5e-324, -1e300), (0.1, 0.0, 1.0, 1e300), ("float",), "")
    lower, upper = region.ends(PRECISIONS["float"])
    assert lower.dtype == np.float32
    assert (np.float64(lower) >= region.lower).all()
    assert (np.float64(upper) <= region.upper).all()
    assert lower[0] > upper[0]
    assert upper[3] == np.finfo(np.float32).max
    exact = region.ends(PRECISIONS["double"])
    assert (exact[0].tolist(), exact[1].tolist()) == (list(region.lower), list(region.upper))

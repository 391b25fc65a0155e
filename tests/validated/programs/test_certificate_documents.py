"""Certificates of programs in files: what is written, replayed, refused and left undecided."""

import json
from contextlib import suppress

import numpy as np
import pytest

import ccpin
from ccpin import programs
from ccpin.auditing import verify
from ccpin.cli import main
from ccpin.errors import InvalidInputError
from ccpin.proof.facts import NotProvedError
from ccpin.validated import ProgramCertificate, certify_program
from tests.support.forged_programs import campaign, save
from tests.support.forging import Forgery

pytest.importorskip("flint")


@pytest.fixture(scope="module")
def certificate():
    """Of the slider crank's ρ and q̈, found from near by."""
    model = ccpin.ReducedModel(ccpin.load("slider_crank"))
    program = programs.record(model, ("rho", "forward_dynamics"), given="near")
    middle = np.array(program.example[:1])
    return certify_program(program, (middle - 0.1, middle + 0.1), bounds={"v": 1.0, "u": 1.0}, max_cells=8)


@pytest.mark.parametrize("suffix", [".npz", ".json"])
def test_what_is_loaded_is_undecided_until_it_is_replayed(certificate, suffix, tmp_path):
    path = tmp_path / f"kept{suffix}"
    certificate.save(path)
    loaded = ProgramCertificate.load(path)
    assert loaded.verdict == "undecided"
    assert loaded.program.digest == certificate.program.digest
    with pytest.raises(InvalidInputError, match="nothing to save"):
        loaded.save(tmp_path / "again.npz")
    with pytest.raises(InvalidInputError, match="no region"):
        loaded.guarded()
    again = loaded.replay()
    assert again.verdict == "proven"
    assert again.statement() == certificate.statement()
    assert again.guarded().digest == certificate.guarded().digest
    with pytest.raises(InvalidInputError, match="ccpin-program-1"):
        verify(path)


def test_it_is_about_its_mechanism_s_closures(certificate):
    assert certificate.is_about(ccpin.load("slider_crank"))
    assert not certificate.is_about(ccpin.load("four_bar"))
    assert not certificate.is_about(ccpin.load("rpdr"))


def changed_program(document, change):
    """A document whose program is another, its digest right."""
    from ccpin.programs.program import _digest

    program = json.loads(document.header["program"])
    program.pop("digest")
    change(program)
    return document.header | {"program": json.dumps(program | {"digest": _digest(program)})}


def changed_source(document, change):
    """A document whose source is another."""
    source = json.loads(document.header["source"])
    change(source)
    return document.header | {"source": json.dumps(source)}


REFUSED = {
    "formats of none": lambda d: d.header | {"formats": []},
    "a format twice": lambda d: d.header | {"formats": ["double", "double"]},
    "a format that there is not": lambda d: d.header | {"formats": ["half"]},
    "no source": lambda d: d.header | {"source": "{}"},
    "no JSON": lambda d: d.header | {"program": "{"},
    "deep JSON": lambda d: d.header | {"source": "[" * 100_000},
    "a memory full of values": lambda d: changed_source(d, lambda s: s["closure"].update(size=10**12)),
    "steps without end": lambda d: changed_source(d, lambda s: s.update(steps=10**6)),
    "no steps at all": lambda d: changed_source(d, lambda s: s.update(steps=-1)),
    "a constant without end": lambda d: changed_source(d, lambda s: _set(s, "scale", 4, "1e999999999")),
    "a constant over 0": lambda d: changed_source(d, lambda s: _set(s, "scale", 4, "1/0")),
    "a constant of a sum": lambda d: changed_source(d, lambda s: _set(s, "add", 4, "1/2")),
    "a sample that is none": lambda d: changed_source(d, lambda s: s["samples"][0].__setitem__(0, "1")),
    "a sample that is whole": lambda d: changed_source(d, lambda s: s["samples"][0].__setitem__(0, 1)),
    "a sample without end": lambda d: changed_source(d, lambda s: s["samples"][0].__setitem__(0, 1e999)),
    "values of no whole number": lambda d: changed_source(d, lambda s: s["closure"].update(size=99.5)),
    "an operation that there is not": lambda d: changed_source(d, lambda s: _set(s, "add", 0, "nothing")),
    "an operand that is not there": lambda d: changed_source(d, lambda s: _set(s, "add", 2, 10**6)),
    "a name that is none": lambda d: changed_source(d, lambda s: s["ports"][0].__setitem__(0, 3)),
}
UNDECIDED = {
    "exchanged names": lambda d: changed_program(
        d, lambda p: [p["inputs"][2 + k].update(name="uv"[k]) for k in (0, 1)]
    ),
    "another operation": lambda d: changed_program(d, lambda p: _subtracted(p)),
    "another pivot": lambda d: changed_program(d, lambda p: p["pivots"][0].__setitem__(1, (9.0).hex())),
    "fewer corrections": lambda d: changed_program(d, lambda p: p["corrections"].pop()),
    "a region of its own": lambda d: changed_program(d, lambda p: p.update(region=_everywhere(p))),
    "fewer steps": lambda d: changed_source(d, lambda s: s.update(steps=1)),
    "another closure": lambda d: changed_source(d, lambda s: _subtracted(s["closure"])),
    "other dynamics": lambda d: changed_source(d, lambda s: _subtracted(s["inner"])),
}


def _first_of(code, word):
    return next(entry for entry in code["instructions"] if entry[0] == word)


def _subtracted(code):
    _first_of(code, "add")[0] = "subtract"


def _set(source, word, place, value):
    _first_of(source["inner"], word)[place] = value


def _everywhere(program):
    size = sum(len(port["entries"]) for port in program["inputs"])
    ends = {"lower": [(-1e9).hex()] * size, "upper": [(1e9).hex()] * size}
    return ends | {"formats": ["double"], "statement": "Proved everywhere."}


@pytest.mark.parametrize("way", REFUSED)
def test_forged_files_are_refused_by_name(certificate, way, tmp_path):
    certificate.save(tmp_path / "as_it_is.npz")
    document = Forgery.of(tmp_path / "as_it_is.npz")
    save(document._replace(header=REFUSED[way](document)), tmp_path / "forged.npz")
    with pytest.raises(InvalidInputError, match=r"forged\.npz"):
        ProgramCertificate.load(tmp_path / "forged.npz")


@pytest.mark.parametrize("way", UNDECIDED)
def test_forged_programs_are_undecided(certificate, way, tmp_path):
    """Facts about what they were put together of are none about them."""
    certificate.save(tmp_path / "as_it_is.npz")
    document = Forgery.of(tmp_path / "as_it_is.npz")
    save(document._replace(header=UNDECIDED[way](document)), tmp_path / "forged.npz")
    loaded = ProgramCertificate.load(tmp_path / "forged.npz")
    with suppress(NotProvedError):
        assert loaded.replay().verdict == "undecided"


def test_no_forged_certificate_is_accepted_and_false():
    """Some; ``python -m tests.support.forged_programs`` makes as many as are asked for."""
    happened, false = campaign(12, seed=7)
    assert false == []
    assert sum(happened.values()) == 12


@pytest.mark.slow
def test_no_forged_certificate_of_many_is_accepted_and_false():
    happened, false = campaign(1200, seed=3)
    assert false == []
    assert set(happened) == {"refused by name", "undecided", "accepted and true"}


def test_the_command_line_certifies_keeps_and_replays(tmp_path, monkeypatch, capsys):
    """What is undecided is not written; what is kept is proved again, and is about its mechanism alone."""
    monkeypatch.chdir(tmp_path)
    asked = ["export", "slider_crank", "--what", "forward_dynamics", "--bounds", "v=1", "u=0.5,", "--name", "f"]
    box, wide = (["--lower-deg", a, "--upper-deg", b] for a, b in (("55", "65"), ("-1000", "1000")))
    asked += ["--max-cells", "16"]
    assert main([*asked, *box, "--out", "out"]) == 1  # "0.5," is no number
    asked[6] = "u=0.5"
    assert main([*asked, "--out", "out"]) == 1  # bounds without a box
    assert main([*asked, "--lower-deg", "55", "--out", "out"]) == 1
    assert main([*asked, *wide, "--save", "kept.npz", "--out", "out"]) == 3
    assert list(tmp_path.iterdir()) == []
    capsys.readouterr()
    assert main([*asked, *box, "--save", "kept.npz", "--out", "out"]) == 0
    said = capsys.readouterr().out
    statement = ProgramCertificate.load("kept.npz").replay().statement()
    assert statement in said
    assert all(line in (tmp_path / "out" / "f.h").read_text() for line in statement.splitlines())
    assert main(["verify", "kept.npz", "--model", "slider_crank"]) == 0
    assert statement in capsys.readouterr().out
    assert main(["verify", "kept.npz", "--model", "four_bar", "--json"]) == 4
    told = json.loads(capsys.readouterr().out)
    assert (told["verdict"], told["model"], told["statement"]) == ("proven", False, statement)
    assert main(["verify", "kept.npz", "--sample", "3"]) == 1
    document = Forgery.of(tmp_path / "kept.npz")
    save(document._replace(arrays=document.arrays | {"radius": 1e-9 * document.arrays["radius"]}), "forged.npz")
    assert main(["verify", "forged.npz"]) == 3
    assert "undecided" in capsys.readouterr().out

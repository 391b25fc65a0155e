"""Exported C99: it compiles without a warning, tests itself, is the reduced model's, and takes names from anybody."""

import subprocess
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import ccpin
from ccpin import programs
from ccpin.cli import main
from ccpin.dynamics.end_effector import EndEffector
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.programs.c_export import is_taken
from tests.support.exported import STRICT, closed_states, compiler, exported, self_tested
from tests.support.long_cases import later
from tests.support.places import ROOT

SMALL = ("rpdr", "four_bar", "slider_crank", "planar_3rrr", "bennett", "sarrus")
LARGE = ("delta", "hexa", "stewart")
FORMATS = ("double", "float")
ANKLE = str(ROOT / "docs" / "howto" / "ankle.urdf")
MODELS = [*SMALL[:1], *SMALL[4:], *later("", *SMALL[1:4], *LARGE, ANKLE)[1:]]


@pytest.mark.parametrize(
    ("name", "format"),
    [
        *(("rpdr", "float"), ("sarrus", "double")),
        *(
            pytest.param(name, format, marks=pytest.mark.slow)
            for name, format in (
                *product((*SMALL[1:5], *LARGE, ANKLE), FORMATS),
                ("rpdr", "double"),
                ("sarrus", "float"),
            )
        ),
    ],
)
def test_the_test_that_is_written_passes(loaded, name, format, tmp_path):
    """At all its states, to the last bit, with q′ closed and with σ found; -Wall -Wextra -Wconversion -pedantic."""
    asked = {"closed": ["forward_dynamics", "mass", "rho"], "near": ["sigma", "forward_dynamics", "gravity"]}
    for given, what in asked.items():
        program = programs.record(loaded(name), what, given=given)
        said = self_tested(program, tmp_path, format, f"own_{given}")
        assert said == f"own_{given}: 0 of 24 states wrong, 24 the same to the last bit\n"


@pytest.mark.parametrize("name", MODELS)
def test_it_is_the_reduced_model_s(loaded, name, tmp_path):
    """q̈ of random closed states within 1e-12 of its size times the condition; float within 2⁻²⁰ of it times that."""
    model, rng = loaded(name), np.random.default_rng(1)
    program = programs.record(model, "forward_dynamics")
    states, numbers = closed_states(model, 40)
    v, u = rng.normal(size=(40, model.n)), rng.normal(size=(40, model.n_actuated))
    rows = np.hstack([numbers, *({"v": v, "u": u}[port.name] for port in program.inputs[2:])])
    for format, within in (("double", 1e-12), ("float", 2.0**-20)):
        found, status = exported(program, tmp_path, format, f"as_{format}")(rows)
        assert (status == 0).all()
        for state, one, rate, effort in zip(states, found, v, u, strict=True):
            wanted = state.forward_dynamics(rate, effort)
            condition = max(1.0 / state.rcond, np.linalg.cond(state.D))
            assert np.abs(one - wanted).max() <= within * condition * max(1.0, np.abs(wanted).max())


def test_sigma_is_found_or_refused(loaded, tmp_path):
    """From 0.02 rad away y is the model's; from far away, from no number, and beyond the reach the status says so."""
    model = loaded("rpdr")
    run = exported(programs.record(model, "sigma", given="near", steps=3), tmp_path)
    _, numbers = closed_states(model, 200)
    off = numbers.copy()
    off[:, 2:] += np.random.default_rng(2).uniform(-0.02, 0.02, off[:, 2:].shape)
    found, status = run(off)
    assert (status == 0).all()
    np.testing.assert_allclose(found, numbers[:, 2:], rtol=0, atol=1e-12)
    off[:, 2:] += 1.0
    assert (run(off)[1] != 0).all()
    hostile = np.tile(numbers[0], (4, 1))
    hostile[0, 0], hostile[1, 3], hostile[2, 2], hostile[3, 1] = np.nan, np.inf, 1.1e5, -1e300
    assert (run(hostile)[1] == 1).all()


def test_a_singular_solve_is_told(loaded, tmp_path):
    """Within 1e-7 rad of where the four-bar's coupler and rocker are along one line, and not on a coarse grid."""
    model = loaded("four_bar")
    program = programs.record(model, "rho")
    run, column = exported(program, tmp_path), 1 + program.inputs[1].entries.index("rocker")
    rows, low, high = np.tile(closed_states(model, 1)[1], (4001, 1)), -3.0, 3.0
    for _ in range(4):
        rows[:, column] = np.linspace(low, high, 4001)
        found, status = run(rows)
        np.testing.assert_array_equal(status, program(q=rows[:, :1], y=rows[:, 1:]).status)
        assert np.isfinite(found[status == 0]).all()
        if (status == 1).any():
            break
        worst = np.abs(found).max(axis=1).argmax()
        low, high = rows[worst - 1, column], rows[worst + 1, column]
    assert 1e-8 < high - low < 1.0
    assert 1 <= (status == 1).sum() < 100


@pytest.mark.parametrize("count", later(3, 6))
def test_a_header_that_computes_something_else_is_noticed(loaded, tmp_path, count):
    """One sign, one digit, one index, the status: the written test ends with 1."""
    header, test = programs.export(programs.record(loaded("rpdr"), "forward_dynamics"), tmp_path, name="f")
    text = header.read_text()
    lines = [k for k, line in enumerate(text.splitlines()) if line.strip().startswith("const double t")]
    changes = []
    for k in lines[:: max(1, len(lines) // count)]:
        whole = text.splitlines()
        name, _, value = whole[k].partition(" = ")
        whole[k] = f"{name} = 1.01 * ({value.rstrip(';')});"
        changes.append("\n".join(whole) + "\n")
    changes.append(text.replace("return status;", "return !status;"))
    unnoticed = 0
    for changed in changes:
        header.write_text(changed)
        subprocess.run([compiler(), "-O1", str(test), "-o", str(tmp_path / "t"), "-lm"], check=True)
        done = subprocess.run([str(tmp_path / "t")], capture_output=True, text=True, check=False)
        unnoticed += done.returncode == 0
        assert done.returncode == 0 or "comes out wrong" in done.stdout
    assert unnoticed == 0


def test_no_heap_and_no_globals(loaded, tmp_path):
    """Of the compiled header nothing but the one function is seen, and no data that could be written to."""
    exported(programs.record(loaded("planar_3rrr"), ["forward_dynamics", "sigma"], given="near"), tmp_path)
    done = subprocess.run(
        [compiler("nm"), str(tmp_path / "exported_many.so")], capture_output=True, text=True, check=True
    )
    own = [line.split()[-2:] for line in done.stdout.splitlines() if "exported" in line]
    assert {kind for kind, _ in own} <= {"t", "r"}
    assert not {"malloc", "calloc", "realloc"} & set(done.stdout.replace("@", " ").split())


def test_two_headers_in_one_file(loaded, tmp_path):
    """Double and float, two mechanisms, beside <complex.h> and a BITS and R of somebody else's; as C++ too."""
    programs.export(programs.record(loaded("rpdr"), "forward_dynamics"), tmp_path, name="one")
    programs.export(programs.record(loaded("four_bar"), ["mass", "gravity"]), tmp_path, name="ONE", format="float")
    both = '#include "one.h"\n#include "ONE.h"\n#include "one.h"\nint main(void) { return one_OK + ONE_OK; }\n'
    (tmp_path / "both.c").write_text(
        f"#include <complex.h>\n#define BITS 3\n#define LANES 5\n{both}#if LANES != 5\n#error\n#endif\n"
    )
    subprocess.run([compiler(), *STRICT, "-c", "both.c"], check=True, cwd=tmp_path)
    (tmp_path / "both.cpp").write_text(both)
    subprocess.run([compiler("g++"), "-O2", "-Wall", "-Wextra", "-c", "both.cpp"], check=True, cwd=tmp_path)


HOSTILE = '*/ int main(void) { return 1; } /* "???/\n#error \\' + "\u202e\u2066é\x00\\"


def test_names_of_mechanisms_and_points_do_no_harm(loaded, tmp_path):
    """Comments stay comments, ports get names of their own."""
    model = loaded("rpdr")
    end = EndEffector(model, list(model.mechanism.tree.attachments)[1])
    points = dict.fromkeys(
        ("for", "a-b", "a_b", "a b", "R", "k", "n", "large", "sin", "x_", "q_", "f", "f_OK", HOSTILE), end
    )
    program = replace(programs.record(model, list(points), points=points), name=HOSTILE)
    for name in (None, "f"):
        assert "the same to the last bit" in self_tested(program, tmp_path, name=name)
    for path in tmp_path.glob("*.h"):
        text = path.read_text()
        assert text.count("*/") == 2
        assert all(letter.isprintable() or letter == "\n" for letter in text)


@pytest.mark.parametrize(
    "name", ["", "2x", "for", "a b", "sinf", "main", "../x", "é", "_x", "x" * 49, "a\n", 3, b"x", "fabs"]
)
def test_a_name_that_c_has_not_is_refused(loaded, name, tmp_path):
    """And nothing is written."""
    with pytest.raises(InvalidInputError, match="name must be a C function's"):
        programs.export(programs.record(loaded("four_bar"), "mass"), tmp_path / "new", name=name)
    assert not (tmp_path / "new").exists()
    assert is_taken(str(name)) == (name in ("for", "sinf", "main", "fabs"))


def test_a_folder_that_is_none_is_refused(loaded, tmp_path):
    """A file, no name, something else; a target and a format that there is not."""
    program = programs.record(loaded("four_bar"), "mass")
    (tmp_path / "file").write_text("kept")
    for folder in (tmp_path / "file", tmp_path / "file" / "below", "", None, 3):
        with pytest.raises(InvalidInputError):
            programs.export(program, folder)
    assert (tmp_path / "file").read_text() == "kept"
    for wrong in ({"target": "fortran"}, {"format": "half"}):
        with pytest.raises(InvalidInputError):
            programs.export(program, tmp_path / "new", **wrong)
    with pytest.raises(InvalidInputError):
        programs.export("program", tmp_path / "new")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file"]


def test_a_constant_too_large_for_floats_is_refused(tmp_path):
    """A gravity of 1e45 m/s²; in doubles it is a number."""
    model = ccpin.ReducedModel(ccpin.load("four_bar"), gravity=(0.0, 0.0, -1e45))
    program = programs.record(model, "gravity")
    with pytest.raises(CcpinError, match="no number of the format float"):
        programs.export(program, tmp_path, format="float")
    assert "last bit" in self_tested(program, tmp_path)


def test_json_is_what_save_writes(loaded, tmp_path):
    program = programs.record(loaded("rpdr"), "mass")
    (path,) = programs.export(program, tmp_path, "json", name="terms")
    assert path.name == "terms.json"
    assert programs.Program.load(path).digest == program.digest


def test_the_command_line_writes_where_it_is_told(tmp_path, monkeypatch, capsys):
    """One folder, of --out; none where what is asked for is not known."""
    monkeypatch.chdir(tmp_path)
    assert main(["export", "rpdr", "--what", "nonsense", "--out", "none"]) == 1
    assert main(["export", "rpdr", "--what", "torque", "--kp", "1", "--out", "none"]) == 1
    assert list(tmp_path.iterdir()) == []
    capsys.readouterr()
    asked = ["export", "rpdr", "--what", "sigma", "torque", "--given", "near", "--precision", "float", "--name", "law"]
    assert main([*asked, "--goal-deg", "-90", "-100", "--kp", "11", "--kv", "0.65", "--out", "deep/er"]) == 0
    assert "wrote deep/er/law.h, deep/er/law_test.c" in capsys.readouterr().out
    subprocess.run([compiler(), *STRICT, "law_test.c", "-o", "law", "-lm"], check=True, cwd=tmp_path / "deep" / "er")
    subprocess.run(["./law"], check=True, cwd=tmp_path / "deep" / "er", capture_output=True)


@pytest.mark.parametrize("law", later("computed_torque", "pd_plus", "online"))
def test_the_command_line_knows_laws_that_track(law, tmp_path, capsys):
    """Their reference is an input; the help says of their efforts what the header says; no law at all is refused."""
    asked = ["export", "rpdr", "--what", "sigma", "torque", "--given", "near", "--law", law, "--name", "law"]
    assert main([*asked, "--out", str(tmp_path)]) == 0
    assert "not clipped to the motors' limits" in capsys.readouterr().out
    text = (tmp_path / "law.h").read_text()
    assert "in  q_d[2], rad: joint1, joint2" in text
    assert "not clipped" in text
    subprocess.run([compiler(), *STRICT, "law_test.c", "-o", "law", "-lm"], check=True, cwd=tmp_path)
    subprocess.run(["./law"], check=True, cwd=tmp_path, capture_output=True)
    with pytest.raises(SystemExit):
        main(["export", "rpdr", "--what", "torque", "--law", "none", "--out", str(tmp_path / "none")])
    assert main(["export", "rpdr", "--what", "law", "--out", str(tmp_path / "none")]) == 1
    assert "did you mean 'torque'" in capsys.readouterr().err
    assert main(["export", "rpdr", "--what", "torque", "--moving", "--name", "to", "--out", str(tmp_path)]) == 0
    assert "g_d[2], N m or N" in (tmp_path / "to.h").read_text()

"""Certificates of programs against exact arithmetic: errors of rounding, ranges, pivots, σ's steps; nothing beyond."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin import programs
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.programs.compiling import NoCompilerError
from ccpin.programs.evaluation import values_of
from ccpin.programs.instructions import Kind
from ccpin.programs.lanes import CompiledProgram
from ccpin.programs.program_sources import assembled
from ccpin.validated import certify_program
from tests.support.long_cases import later
from tests.support.programs import BITS, exact_sigma, exact_values, on_branch, states

flint = pytest.importorskip("flint")
KNOWN = {"rpdr": 0.05, "slider_crank": 0.1}


@pytest.fixture(scope="module")
def certificates():
    """Of programs of closed configurations, and of ones near by."""
    found = {}
    for name, half in KNOWN.items():
        model = ccpin.ReducedModel(ccpin.load(name))
        for given, what in (("closed", "forward_dynamics"), ("near", ("sigma", "forward_dynamics"))):
            program = programs.record(model, what, given=given)
            middle = np.array(program.example[: model.n])
            box = (middle - half, middle + half)
            found[name, given] = certify_program(program, box, bounds={"v": 1.0, "u": 2.0}, max_cells=64)
    return found


def compiled(program):
    """It in float, compiled."""
    try:
        return CompiledProgram(program, "float")
    except NoCompilerError:
        pytest.skip("no C compiler")


@pytest.mark.parametrize("count", later(10, 40))
@pytest.mark.parametrize("name", KNOWN)
@pytest.mark.parametrize("given", ["closed", "near"])
def test_no_error_is_beyond_what_is_proved(certificates, name, given, count):
    """At random states the outputs in double, and in float, against exact ones at the exact σ(q), or at the y given."""
    certificate = certificates[name, given]
    assert certificate.verdict == "proven", certificate.reason
    program, rng = certificate.program, np.random.default_rng(3)
    q, rest = (each.astype(np.float32).astype(float) for each in states(rng, certificate, count))
    y = on_branch(certificate, q)
    y = (y + 0.9 * rng.uniform(-1, 1, y.shape) * certificate.start).astype(np.float32).astype(float)
    ends = np.cumsum([port.size for port in program.inputs[2:]])[:-1]
    inputs = [q, y, *np.split(rest, ends, axis=1)]
    doubles = program(**dict(zip([port.name for port in program.inputs], inputs, strict=True)))
    singles, status = compiled(program)(*inputs)[:-1], compiled(program)(*inputs)[-1]
    assert not doubles.status.any()
    assert not status.any() or not certificate.always_trusted("float")
    with flint.ctx.workprec(BITS):
        exact = [_truth(program, *row) for row in zip(q, y, rest, strict=True)]
    for format, found in (("double", list(doubles.values())), ("float", singles)):
        proved, places = certificate.error(format), certificate.ranges(format)
        for port, values, k in zip(program.outputs, found, range(9), strict=False):
            true = np.array([row[k] for row in exact])
            assert (np.abs(np.asarray(values) - true) <= proved[port.name]).all()
            assert (places[port.name][0] <= true).all()
            assert (true <= places[port.name][1]).all()
    worst = np.abs(doubles["forward_dynamics"] - [row[-1] for row in exact]).max()
    assert certificate.error()["forward_dynamics"].max() <= (300 if given == "closed" else 1e7) * worst


def _truth(program, q, y, rest):
    """Exact outputs, port by port, rounded to doubles; what is left out of the difference is below 1e-16 of it."""
    source = program.source
    if source.steps:
        code = assembled(source._replace(steps=0)).code
        return _split(program, exact_values(code, [*q, *exact_sigma(source, q, y), *rest]))
    return _split(program, exact_values(program.code, [*q, *y, *rest]))


def _split(program, numbers):
    found, first = [], 0
    for port in program.outputs:
        part = np.array([float(x.mid()) for x in numbers[first : first + port.size]])
        found.append(part.reshape(port.shape))
        first += port.size
    return found


@pytest.mark.parametrize("name", KNOWN)
def test_branches_are_those_of_exact_closures(certificates, name):
    """At random q the closed configuration is in the tube of its cell, to the bound that is proved."""
    certificate = certificates[name, "near"]
    claim, source = certificate.branch.claim, certificate.program.source
    q = states(np.random.default_rng(5), certificate, 20)[0]
    for point, y in zip(q, on_branch(certificate, q), strict=True):
        with flint.ctx.workprec(BITS):
            exact = np.array([float(each.mid()) for each in exact_sigma(source, point, y)])
        share = (point - claim.lower) / (claim.upper - claim.lower)
        place = np.minimum((share * claim.counts).astype(int), claim.counts - 1)
        cell = np.ravel_multi_index(tuple(place), tuple(claim.counts))
        centre = claim.lower + (place + 0.5) / claim.counts * (claim.upper - claim.lower)
        off = np.abs(exact - claim.centre[cell] - claim.slopes[cell] @ (point - centre))
        assert (off <= certificate.branch.found["image"][cell] + 1e-14).all()


@pytest.mark.parametrize("name", KNOWN)
def test_pivots_and_sizes_hold_at_states(certificates, name):
    """No pivot is smaller and no value larger than is proved, at random states in double."""
    certificate = certificates[name, "closed"]
    found = certificate.computed[0].found
    q, rest = states(np.random.default_rng(7), certificate, 300)
    y = on_branch(certificate, q)
    values = values_of(certificate.program.code, [*q.T, *y.T, *rest.T], np)
    numbers = [pivot.number for pivot in certificate.program.pivots]
    least = np.array([np.abs(values[k]).min() for k in numbers])
    assert (found["pivots"] <= least).all()
    assert (found["pivots"] >= 0.5 * least).all()
    sizes = np.array([0.0 if value is None else np.abs(value).max() for value in values])
    assert (sizes <= found["size"]).all()
    assert 2 ** certificate.bits()["everything"] > sizes.max()


def test_what_is_told(certificates):
    certificate = certificates["rpdr", "near"]
    text = certificate.statement()
    assert certificate.program.digest in text
    assert "2 Newton steps" in text
    assert "double" in text
    assert certificate.always_trusted()
    assert set(certificate.bits()) == {"sigma", "forward_dynamics", "everything"}
    assert "cells" in repr(certificate)


def test_pickled_it_is_undecided_until_it_is_replayed(certificates):
    certificate = certificates["slider_crank", "near"]
    copy = pickle.loads(pickle.dumps(certificate))
    assert copy.verdict == "undecided"
    assert copy.statement().startswith("undecided")
    with pytest.raises(InvalidInputError, match="nothing is proved"):
        copy.error()
    again = copy.replay()
    assert again.verdict == "proven"
    assert again.statement() == certificate.statement()


def test_regions_that_hold_a_singularity_are_undecided():
    model = ccpin.ReducedModel(ccpin.load("slider_crank"))
    program = programs.record(model, "forward_dynamics")
    middle = np.array(program.example[:1])
    found = certify_program(program, (middle - 4.0, middle + 4.0), bounds={"v": 1.0, "u": 1.0}, max_cells=16)
    assert found.verdict == "undecided"
    assert "max_cells" in found.reason
    assert found.replay() is found


def test_wrong_arguments_of_regions(certificates, tmp_path):
    certificate = certificates["slider_crank", "closed"]
    program, box = certificate.program, (certificate.lower, certificate.upper)
    good = {"v": 1.0, "u": 1.0}
    for region, bounds, more in (
        (box[::-1], good, {}),
        (box, {"v": 1.0}, {}),
        (box, {"v": -1.0, "u": 1.0}, {}),
        (box, {"v": [1.0, 2.0], "u": 1.0}, {}),
        (box, good, {"formats": ("half",)}),
        (box, good, {"start": 0.0}),
        (box, good, {"max_cells": 0}),
    ):
        with pytest.raises(InvalidInputError):
            certify_program(program, region, bounds=bounds, **more)
    program.save(tmp_path / "p.json")
    with pytest.raises(InvalidInputError, match="loaded"):
        certify_program(programs.Program.load(tmp_path / "p.json"), box, bounds=good)


@pytest.fixture(scope="module")
def open_to():
    """The slider crank's σ and q̈ with gravity, a mass and a length as inputs."""
    model = ccpin.ReducedModel(ccpin.load("slider_crank"))
    what, names = ("sigma", "forward_dynamics"), ("gravity", "mass:crank", "length:rod")
    program = programs.record(model, what, given="near", parameters=names)
    q, p = np.array(program.example[:1]), np.array(program.example[-3:])
    box, known = (q - 0.05, q + 0.05), (0.99 * p, 1.01 * p)
    return certify_program(program, box, bounds={"v": 1.0, "u": 1.0}, parameters=known, max_cells=16)


def test_constants_that_are_inputs(open_to):
    """σ(q, p) and q̈ at random (q, p) against exact numbers; the program refuses other constants."""
    assert open_to.verdict == "proven", open_to.reason
    assert "σ(q, p)" in open_to.statement()
    program, equations, rng = open_to.program, open_to.branch.claim.equations, np.random.default_rng(4)
    guarded, plain = open_to.guarded(), assembled(program.source._replace(steps=0)).code
    for _ in range(20):
        q = rng.uniform(open_to.lower, open_to.upper)
        rest = open_to.bounds * rng.uniform(-1, 1, len(open_to.bounds))
        y = np.array(program.example[1:3])
        with flint.ctx.workprec(BITS):
            exact = exact_sigma(_Places(program.source, equations.places), q, y)
            true = exact_values(plain, equations.arranged([*q], exact, [*rest]))
            wanted = np.array([float(x.mid()) for x in true])
        near = [float(x.mid()) for x in exact] + open_to.start * rng.uniform(-1, 1, 2)
        row = np.array(equations.arranged([*q], [*near], [*rest]))
        given = dict(zip([port.name for port in program.inputs], np.split(row, [1, 3, 4, 5]), strict=True))
        found = guarded(**given)
        assert found.status == 0
        off = np.concatenate([*found.values()]) - wanted
        assert (np.abs(off) <= np.concatenate([*open_to.error().values()])).all()
        lower, upper = (np.concatenate(ends) for ends in zip(*open_to.ranges().values(), strict=True))
        assert ((lower <= wanted) & (wanted <= upper)).all()
        assert guarded(**given | {"p": given["p"] * (1.0, 1.0, 1.05)}).status == 3


class _Places:
    """A source whose closures are solved at (q, p)."""

    def __init__(self, source, places):
        self.closure, self.dependent, self.independent = source.closure, source.dependent, places


def test_a_step_of_the_motion():
    """Outputs in double and float against exact ones, and corrections of y within what is proved."""
    model = ccpin.ReducedModel(ccpin.load("slider_crank"))
    program = programs.record(model, "step")
    middle = np.array(program.example[:1])
    bounds = {"v": 1.0, "u": 1.0, "h": 1e-3}
    certificate = certify_program(program, (middle - 0.02, middle + 0.02), bounds=bounds, max_cells=4)
    assert certificate.verdict == "proven", certificate.reason
    assert certificate.steps is None
    q, rest = (each.astype(np.float32).astype(float) for each in states(np.random.default_rng(3), certificate, 20))
    y = on_branch(certificate, q).astype(np.float32).astype(float)
    inputs = np.split(np.hstack([q, y, rest]), [1, 3, 4, 5], axis=1)
    names = [port.name for port in program.inputs]
    doubles, singles = program(**dict(zip(names, inputs, strict=True))), compiled(program)(*inputs)
    assert not doubles.status.any()
    code = program.code
    with flint.ctx.workprec(BITS):
        wide = code._replace(outputs=(*code.outputs, *program.corrections))
        exact = [[float(x.mid()) for x in exact_values(wide, row)] for row in np.hstack(inputs)]
    exact = np.array(exact)
    for format, found in (("double", np.hstack([*doubles.values()])), ("float", np.hstack(singles[:-1]))):
        told = np.concatenate([*certificate.error(format).values()])
        assert (np.abs(found - exact[:, : len(told)]) <= told).all()
        moved = certificate.computed[format == "float"].found["correction"][0]
        assert np.linalg.norm(exact[:, len(told) :], axis=1).max() <= moved
        assert 0 < moved < 0.1
    assert not certificate.always_trusted()
    assert "status is 0 or 2" in certificate.statement()
    steady = certify_program(program, (middle, middle + 1e-9), bounds=dict.fromkeys(bounds, 1e-9), max_cells=1)
    assert steady.always_trusted("double") == (steady.computed[0].found["correction"][0] <= 0.9e-6)


def test_what_reads_the_turn_of_a_ball_is_refused(certificates):
    """By name, as no certificate."""
    program = certificates["slider_crank", "closed"].program
    inner = program.source.inner
    turned = inner.instructions[0]._replace(kind=Kind.GAIN, a=0, b=0, constant=None)
    source = program.source._replace(inner=inner._replace(instructions=(turned, *inner.instructions[1:])))
    with pytest.raises(UnsupportedMechanismError, match="turned"):
        certify_program(replace(program, source=source), ([1.0], [1.1]), bounds={"v": 1.0, "u": 1.0})


def test_parameters_are_asked_for_where_they_are_read(certificates, open_to):
    box = ([1.0], [1.1])
    good, program = {"v": 1.0, "u": 1.0}, open_to.program
    low, high = open_to.lower[1:], open_to.upper[1:]
    for wrong in (None, (high, low), (low[:1], high[:1]), (low, np.full(3, np.nan)), low, "ab"):
        with pytest.raises(InvalidInputError, match="parameters"):
            certify_program(program, box, bounds=good, parameters=wrong)
    with pytest.raises(InvalidInputError, match="bounds"):
        certify_program(program, box, bounds=good | {"p": 1.0}, parameters=(low, high))
    with pytest.raises(InvalidInputError, match="parameters"):
        certify_program(certificates["slider_crank", "closed"].program, box, bounds=good, parameters=(low, high))

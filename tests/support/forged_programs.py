"""Forged certificates of programs: changed documents whose checksums and digests are right again, and what is true.

Run as ``python -m tests.support.forged_programs [--count 2000] [--seed 0]``.
"""

import argparse
import copy
import json
import sys
import tempfile
from collections import Counter
from pathlib import Path

import flint
import numpy as np

import ccpin
from ccpin import programs
from ccpin.containers import checksum
from ccpin.errors import CcpinError
from ccpin.programs import program as program_module
from ccpin.programs.program_sources import assembled
from ccpin.proof.facts import NotProvedError
from ccpin.validated import ProgramCertificate, certify_program
from tests.support.forging import KINDS, Forgery
from tests.support.programs import BITS, exact_sigma, exact_values, on_branch, states


def originals(folder):
    """Certificates of two programs, with Newton's steps and without, as documents."""
    made = {}
    for name, given, what in (
        ("slider_crank", "near", ("sigma", "forward_dynamics")),
        ("four_bar", "closed", ("rho", "gravity")),
    ):
        model = ccpin.ReducedModel(ccpin.load(name))
        program = programs.record(model, what, given=given)
        middle = np.array(program.example[:1])
        bounds = {port.name: 1.0 for port in program.inputs[2:]}
        certificate = certify_program(program, (middle - 0.1, middle + 0.1), bounds=bounds, max_cells=8)
        assert certificate.verdict == "proven"
        certificate.save(folder / f"{name}.npz")
        made[name] = Forgery.of(folder / f"{name}.npz")
    return made


def save(document, path):
    """Write it, its checksum made right."""
    header = document.header | {}
    header["checksum"] = checksum(header, document.arrays)
    text = np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)
    np.savez(path, header=text, **document.arrays)


def forged(rng, known, name):
    """A document with a change or two, and what they are."""
    made = copy.deepcopy(known[name])
    other = known[str(rng.choice(sorted(known)))]
    return made, "; ".join(_changed(rng, made, other) for _ in range(1 + int(rng.integers(2))))


def _changed(rng, made, other):
    way = rng.random()
    if way < 0.1:
        name = str(rng.choice(sorted(made.header)))
        made.header[name] = other.header[name]
        return f"{name} another's"
    if way < 0.5:
        return _text(rng, made, str(rng.choice(["program", "source"])))
    name = str(rng.choice(sorted(made.arrays)))
    kinds = [kind for kind, (fits, _) in KINDS.items() if fits(made.arrays[name])]
    if not kinds or rng.random() < 0.1:
        made.arrays[name] = other.arrays[name]
        return f"{name} another's"
    kind = str(rng.choice(kinds))
    with np.errstate(all="ignore"):
        made.arrays[name] = KINDS[kind][1](rng, made.arrays[name].copy())
    return f"{name} {kind}"


def _text(rng, made, name):
    """One leaf of a header's JSON changed; a program's digest made right."""
    document = json.loads(made.header[name])
    place, key = document, str(rng.choice(sorted(document)))
    told = [key]
    while isinstance(place[key], list | dict) and len(place[key]):
        place = place[key]
        key = int(rng.integers(len(place))) if isinstance(place, list) else str(rng.choice(sorted(place)))
        told.append(str(key))
    old = place[key]
    if isinstance(old, str):
        place[key] = str(
            rng.choice(["", "q", "y", "v", "-1/3", "add", "sine", "0x1p+400", "nan", old[::-1], f"-{old}"])
        )
    elif isinstance(old, list | dict):
        place[key] = [1]
    else:
        choices = [0, -1, 1, None, 1e300, float(old or 0) / 2]
        place[key] = old + int(rng.integers(-3, 4)) if type(old) is int else choices[int(rng.integers(len(choices)))]
    if name == "program":
        document.pop("digest", None)
        document["digest"] = program_module._digest(document)
    made.header[name] = json.dumps(document)
    return f"{name} {'.'.join(told)}: {old!r:.30} -> {place[key]!r:.30}"


def outcome(rng, path, count=6):
    """What becomes of a document; what is accepted is compared with exact numbers."""
    try:
        certificate = ProgramCertificate.load(path)
    except CcpinError as error:
        return "refused by name" if str(path) in str(error) else f"false: refused without a name: {error}"
    assert certificate.verdict == "undecided"
    try:
        certificate = certificate.replay()
    except NotProvedError:
        return "undecided"
    if certificate.verdict != "proven":
        return "undecided"
    found = falsehood(rng, certificate, count)
    return "accepted and true" if found is None else f"false: {found}"


def falsehood(rng, certificate, count):
    """What of a certificate is false at random states, if anything: σ, errors, ranges, the status."""
    program, source = certificate.program, certificate.program.source
    q, rest = states(rng, certificate, count)
    y = on_branch(certificate, q)
    y = y + rng.uniform(-1, 1, y.shape) * certificate.start
    given = np.split(np.hstack([q, y, rest]), np.cumsum([port.size for port in program.inputs])[:-1], axis=1)
    inputs = {port.name: part.reshape(count, *port.shape) for port, part in zip(program.inputs, given, strict=True)}
    found = program(**inputs)
    format = next(iter(certificate._by_format))
    if certificate.always_trusted(format) and found.status.any():
        return "a status that is not 0"
    told, (lower, upper) = certificate._fact(format).found["error"], certificate._fact(format).found["range"]
    table = np.hstack([found[port.name].reshape(count, port.size) for port in program.outputs])
    for k in range(count):
        with flint.ctx.workprec(BITS):
            end = exact_sigma(source, q[k], y[k]) if source.steps else y[k]
            if source.steps:
                values = exact_values(assembled(source._replace(steps=0)).code, [*q[k], *end, *rest[k]])
                if np.any(np.abs([float(e.mid()) for e in end] - y[k]) > 1.01 * certificate.start):
                    return "another branch"
            else:
                values = exact_values(program.code, [*q[k], *end, *rest[k]])
            exact = np.array([float(value.mid()) for value in values])
        if format == "double" and np.any(np.abs(table[k] - exact) > told + 1e-15 * np.abs(exact)):
            return f"an error of {np.abs(table[k] - exact)} beyond {told}"
        if np.any(exact < lower - 1e-12 * np.abs(exact)) or np.any(exact > upper + 1e-12 * np.abs(exact)):
            return "an output out of its range"
    return None


def campaign(count, seed=0, say=lambda text: None):
    """Counts of what happened to so many, and what was accepted and false."""
    rng, happened, false = np.random.default_rng(seed), Counter(), []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        known = originals(folder)
        for document in known.values():
            save(document, folder / "as_it_is.npz")
            assert outcome(rng, folder / "as_it_is.npz") == "accepted and true"
        for number in range(count):
            document, told = forged(rng, known, sorted(known)[number % len(known)])
            save(document, folder / "forged.npz")
            what = outcome(rng, folder / "forged.npz")
            happened[what.split(":")[0]] += 1
            if what.startswith("false"):
                false.append(f"{told}: {what}")
                say(false[-1])
    return happened, false


def main():
    """Run the campaign and tell."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    happened, false = campaign(options.count, options.seed, lambda text: sys.stdout.write(f"{text}\n"))
    sys.stdout.write(f"{options.count} forged certificates: {dict(happened)}; {len(false)} accepted and false\n")


if __name__ == "__main__":
    main()

"""What is proved of programs beside a million states: `python -m benchmarks.program_proofs [MODEL …] [--states N]`.

Of each mechanism a program with closed configurations given and one with σ found from near by, over a region that is
certified, as exported C in double and in float against the same arithmetic in __float128, at corners, on faces and
inside: the largest error seen and the one proved, how many are beyond. __float128 is itself held against balls of 200
bits (python-flint). The branch is that which the reduced model's own core follows from the reference.

Then states outside of what is proved: y farther from σ(q) than the certificate's start, q beyond its box. Where an
input is outside the certified box the exported C refuses; y may be in the box and yet far from σ at this q.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence

import numpy as np

import ccpin
from benchmarks.firmware import ANKLE
from ccpin import programs
from ccpin.validated import certify_program
from tests.support.beside_states import ProgramCertificate, Region, Seen
from tests.support.quadruple import absent

REGIONS = {"rpdr": (0.05, 1024), "ankle": (0.02, 64), "delta": (0.02, 64)}  # half a box of q, cells at most
FILES = {"ankle": ANKLE}
BOUNDS = {"v": 1.0, "u": 2.0}
RECORDED = {"closed": ("forward_dynamics",), "near": ("sigma", "forward_dynamics")}


def certified(
    name: str, recorded: Sequence[str], cells: int = 0
) -> Iterator[tuple[str, ccpin.ReducedModel, ProgramCertificate]]:
    """Programs of a mechanism, with certificates, of so many cells at most where it is told."""
    model, (half, most) = ccpin.ReducedModel(ccpin.load(FILES.get(name, name))), REGIONS[name]
    for given in recorded:
        program = programs.record(model, RECORDED[given], given=given)
        q = np.array(program.example[: model.n])
        found = certify_program(program, (q - half, q + half), bounds=BOUNDS, max_cells=cells or most)
        assert found.verdict == "proven", found.reason
        yield given, model, found


def main() -> None:
    """A table."""
    parser = argparse.ArgumentParser("python -m benchmarks.program_proofs", description=__doc__)
    parser.add_argument(
        "models", nargs="*", choices=[*REGIONS, []], metavar="MODEL", help=f"of {', '.join(REGIONS)}; all"
    )
    parser.add_argument("--given", nargs="+", choices=list(RECORDED), default=list(RECORDED))
    parser.add_argument("--states", type=int, default=1_000_000)
    parser.add_argument("--exact", type=int, default=1_000, help="of them in balls")
    asked = parser.parse_args()
    for name in asked.models or REGIONS:
        for given, model, certificate in certified(name, asked.given):
            box = f"|q − q₀| ≤ {REGIONS[name][0]}, |y − σ(q)| ≤ {certificate.start.max():.3g}"
            print(f"{model.mechanism.name}, {given}: {box}, |v| ≤ {BOUNDS['v']}, |u| ≤ {BOUNDS['u']}", flush=True)
            for format in ("double", "float"):
                region = Region(model, certificate, format)
                _tell(format, region.seen(asked.states, asked.exact), certificate)
                if given == "near":
                    told = region.outside(asked.states)
                    status, right, wrong = told.others
                    print(
                        f"    outside: of {told.beyond} states beyond the box {told.refused} refused; of others with y "
                        f"too far {status} with a status, {right} right, {wrong} wrong",
                        flush=True,
                    )


def _tell(format: str, seen: Seen, certificate: ProgramCertificate) -> None:
    """Lines of a table."""
    first = 0
    for port in certificate.program.outputs:
        entries = slice(first, first + port.size)
        first += port.size
        off, proved = seen.largest[entries].max(), seen.proved[entries].max()
        print(f"  {format:<6}  {port.name:<16}  seen {off:.2e}  proved {proved:.2e}  ratio {proved / off:.3g}")
    always = "proved to be 0 always" if certificate.always_trusted(format) else "may be 2"
    print(
        f"    of {seen.states} states {seen.beyond} beyond, {seen.wrong} on a wrong branch, {seen.refused} with a "
        f"status that is not 0 ({always}); __float128 is off by {seen.doubt:.1e} of what is proved",
        flush=True,
    )


if __name__ == "__main__":
    if missing := absent():
        raise SystemExit(f"not here: {missing}")
    main()

"""Some thousand forged documents: none that is accepted says what is false.

Run as ``python -m tests.support.forgeries [--count 20000] [--seconds 1500] [--seed 0]``. Each document has one change
or two (`tests.support.forging`), and its fingerprint made right again. It is audited whole. Where it is accepted, what
it says is compared at random points with what is true.
"""

import argparse
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

import ccpin
from ccpin.auditing import verify
from ccpin.domain import JointSpace, certify, certify_sheets, certify_singularities, certify_workspace
from ccpin.errors import CcpinError
from tests.support.forging import Forgery, falsehood, forged

SHARES = (0.2, 0.2, 0.15, 0.15, 0.05, 0.07, 0.18)  # of each original: audits of some take longer


def originals(folder):
    """Small documents of every kind, by name, true as they are."""
    rpdr, four_bar = ccpin.load("rpdr"), ccpin.load("four_bar")
    made = {
        "atlas": certify(four_bar, (0.7,), max_depth=6),
        "atlas of a slide": certify(ccpin.load("slider_crank"), (0.7,), ((0.4,), (1.0,)), max_depth=3),
        "atlas with a fold": certify(
            rpdr, (-1.885, -1.257), ((-2.4, -1.5), (-1.7, -1.0)), max_depth=2, resolution=0.1, exhaustive=True
        ),
        "sheets": certify_sheets(four_bar, ((0.5,), (0.9,)), max_depth=3),
        "sheets with a fold": certify_sheets(rpdr, ((-2.2, -1.8), (-1.4, -1.2)), max_depth=2),
        "curves": certify_singularities(rpdr, np.radians(((118.0, 52.0), (121.0, 55.0)))),
        "workspace": certify_workspace(
            JointSpace(four_bar, ("rocker",)), workspace_region(four_bar), limits={"coupler": (-6.0, 6.0)}, max_depth=3
        ),
    }
    found = {}
    for k, (name, one) in enumerate(made.items()):
        one.save(folder / f"{k}.npz")
        found[name] = Forgery.of(folder / f"{k}.npz")
    return found


def workspace_region(mechanism):
    """About the rocker's angle where the model is at rest."""
    at = mechanism.q_reference[[joint.name for joint in mechanism.tree.joints].index("rocker")]
    return ((at - 0.05,), (at + 0.05,))


def campaign(count, seed=0, seconds=np.inf, say=lambda text: None):
    """Counts of what happened to so many forged documents, what was false and accepted, and the slowest audit."""
    rng, happened, false, slowest = np.random.default_rng(seed), Counter(), [], (0.0, "")
    with tempfile.TemporaryDirectory() as name:
        folder, start = Path(name), time.monotonic()
        known = originals(folder)
        for kind, document in known.items():
            document.save(folder / "as_it_is.npz")
            audit = verify(folder / "as_it_is.npz")
            assert (audit.holds, audit.whole) == (True, True), f"{kind}: {audit}"
            assert falsehood(rng, document, document, folder / "as_it_is.npz", 8) is None, kind
        for number in range(count):
            if time.monotonic() - start > seconds:
                break
            kind = str(rng.choice([*known], p=SHARES))
            document, told = forged(rng, known[kind], list(known.values()), 1 + int(rng.integers(2)))
            path, began = folder / "forged.npz", time.monotonic()
            document.save(path)
            what = outcome(rng, document, known[kind], path)
            slowest = max(slowest, (time.monotonic() - began, f"{kind}: {told}"))
            happened[kind, what.split(":")[0]] += 1
            if what.startswith("false"):
                false.append(f"{kind}: {told}: {what}")
                say(false[-1])
            if (number + 1) % 500 == 0:
                say(f"{number + 1} in {time.monotonic() - start:.0f} s: {total(happened)}")
    return happened, false, slowest


def outcome(rng, document, original, path):
    """What becomes of a forged document."""
    try:
        audit = verify(path)
    except CcpinError as error:
        return "refused by name" if str(path) in str(error) else f"false: refused without a name: {error}"
    if not audit.holds:
        return "refuted" if audit.refuted else "not decided"
    found = falsehood(rng, document, original, path)
    return "accepted and true" if found is None else f"false: {found}"


def total(happened):
    """The counts of all kinds together."""
    found = Counter()
    for (_, what), number in happened.items():
        found[what] += number
    return dict(found)


def main():
    """Run the campaign and tell."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=20_000)
    parser.add_argument("--seconds", type=float, default=np.inf)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    happened, false, slowest = campaign(options.count, options.seed, options.seconds, _say)
    for (kind, what), number in sorted(happened.items()):
        _say(f"{kind}: {what}: {number}")
    _say(f"{sum(happened.values())} forged documents: {total(happened)}; {len(false)} accepted and false")
    _say(f"the slowest took {slowest[0]:.1f} s: {slowest[1]}")


def _say(text):
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()

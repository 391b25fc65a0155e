"""Table I: radii of σ's domain about the paper's four centres, by every certificate there is, and the exact ones.

The exact radius is that of the largest square about the centre on which the RPDR's closed-form σ exists and is
nonsingular. Theorem 2's radius depends on the quadratic form, which the paper does not state; beside the best one, the
form that comes closest to the printed radii is given.
"""

import json
from pathlib import Path

from ccpin import paper
from ccpin.files import write_atomically

OUT = Path("out/domain")


def main(out: Path = OUT) -> None:
    """Compute and print the table; write it as JSON."""
    study = paper.Study()
    rows = study.radii
    names = ("paper", "closest", "theorem2", "reach", "planar", "atlas", "exact")
    print("centre            " + "".join(f"{name:>10}" for name in names))
    for row in rows:
        place = f"({row.centre[0]:.0f}°, {row.centre[1]:.0f}°)"
        print(f"{place:<18}" + "".join(f"{getattr(row, name):9.4f}°" for name in names))
    print(paper.table_one(study).ours)
    write_atomically(out / "table1.json", "w", lambda file: json.dump([row._asdict() for row in rows], file, indent=2))


if __name__ == "__main__":
    from arguments import run

    run(main, __doc__)

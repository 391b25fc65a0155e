"""Fig. 6: the RPDR's (q1, q2) square, both kinds of singularity, what cannot be assembled, 𝒟, Table I's centres."""

from pathlib import Path

from ccpin import paper, plotting

OUT = Path("out/domain")


def main(out: Path = OUT) -> None:
    """Follow the singular curves and draw them."""
    item = paper.figure6(paper.Study())
    for drawing in item.drawings:
        plotting.save(drawing.figure, out / f"{drawing.name}.png")
    for name, value in item.facts:
        print(f"{name}: {value}")
    print(f"{item.compared}: {item.difference:.1e}{item.unit} from the printed ones; figure in {out}/")


if __name__ == "__main__":
    from arguments import run

    run(main, __doc__)

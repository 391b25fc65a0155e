"""Fig. 7: the extreme configurations of Ω around the four centres of Table I, by our radii and by the paper's."""

from pathlib import Path

from ccpin import paper, plotting

OUT = Path("out/domain")


def main(out: Path = OUT) -> None:
    """Compute the radii and draw the corners of the squares that Theorem 2 certifies."""
    study = paper.Study()
    item = paper.figure7(study)
    for drawing in item.drawings:
        plotting.save(drawing.figure, out / f"{drawing.name}.png")
    for row in study.radii:
        print(f"({row.centre[0]:.0f}°, {row.centre[1]:.0f}°): r = {row.theorem2:.2f}° ours, {row.paper:g}° the paper's")
    print(f"figure in {out}/")


if __name__ == "__main__":
    from arguments import run

    run(main, __doc__)

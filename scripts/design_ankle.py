"""A two-rod ankle for its required range: cranks and heel levers so that pitch and roll reach it with room to spare.

The range is certified with the motors' and the foot's limits kept and no singularity passed; the figure is how many
times the required range is certified, and 1 means that it is. Prints the ankle as it is and the best found.
"""

from pathlib import Path

from ccpin import description, domain

MODEL = Path("docs/howto/ankle.urdf")
REQUIRED = (0.60, 0.45)  # rad of pitch and roll to both sides
LINKS = {"cranks": ("left_crank", "right_crank"), "foot": ("foot",)}
RANGES = {"cranks": (0.7, 1.6), "foot": (0.7, 1.6)}
FEET = {"roll": (-0.9, 0.9)}  # the foot's own joint is to allow what the rods do
EVALUATIONS = 40  # designs tried
TOLERANCE = 0.05  # of the cube's size: designs that differ by less are as good


def main(evaluations=EVALUATIONS, model=MODEL):
    """Search, certify and tell."""
    build = domain.scaled_links(description.read_description(model), LINKS)
    found = domain.design(build, RANGES, times_required, start={"cranks": 1.0, "foot": 1.0}, evaluations=evaluations)
    print(f"as it is      {found.trials[0].figure:.3f} × ±{REQUIRED} rad")
    print(f"best          {found.figure:.3f} × ±{REQUIRED} rad  {found.dimensions}")
    print(f"what stops it {found.certificate.obstacle}")
    return found


def times_required(ankle):
    """The largest certified cuboid of (pitch, roll), in units of the required one."""
    space = domain.JointSpace(ankle, ("pitch", "roll"))
    return domain.largest_cube(space, (0.0, 0.0), proportions=REQUIRED, tolerance=TOLERANCE, limits=FEET)


if __name__ == "__main__":
    main()

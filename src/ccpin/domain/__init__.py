"""Where σ is unique and nonsingular: Theorem 2, certificates, atlas, singularities."""

from __future__ import annotations

from ccpin.covering.cells import CellStatus
from ccpin.covering.region import Region
from ccpin.covering.runner import Work
from ccpin.domain.atlas.atlas import Atlas
from ccpin.domain.atlas.certifying import certify
from ccpin.domain.atlas.merged import split_region
from ccpin.domain.atlas.radius_map import certified_radius
from ccpin.domain.atlas.square import kantorovich_radius, newton_steps
from ccpin.domain.closures.seeds import scalar_coordinates_at
from ccpin.domain.closures.task_coordinates import JointSpace
from ccpin.domain.merging import merge
from ccpin.domain.paths.path import CertifiedPath, certify_path
from ccpin.domain.sheets.certifying import certify_sheets
from ccpin.domain.sheets.seams import Fold
from ccpin.domain.sheets.sheets import ModeChange, Sheet, SheetAtlas
from ccpin.domain.singular.certifying import certify_singularities
from ccpin.domain.singular.curve import CertifiedCurve
from ccpin.domain.singular.curves import CrossedCells, SingularCover, UncoveredBoxes
from ccpin.domain.singular.cusp_points import Cusp, cusps
from ccpin.domain.singular.sampled import (
    SingularCurve,
    SingularityDistance,
    serial_singularities,
    singularities,
    singularity_distance,
)
from ccpin.domain.theorem2.polynomials import QuadraticSystem
from ccpin.domain.theorem2.radius import Theorem2Result, theorem2, theorem2_radius
from ccpin.domain.workspaces.largest import LargestWorkspace, largest_ball, largest_cube
from ccpin.domain.workspaces.synthesis import Design, design, scaled_links
from ccpin.domain.workspaces.workspace import certify_workspace

__all__ = [
    "Atlas",
    "CellStatus",
    "CertifiedCurve",
    "CertifiedPath",
    "CrossedCells",
    "Cusp",
    "Design",
    "Fold",
    "JointSpace",
    "LargestWorkspace",
    "ModeChange",
    "QuadraticSystem",
    "Region",
    "Sheet",
    "SheetAtlas",
    "SingularCover",
    "SingularCurve",
    "SingularityDistance",
    "Theorem2Result",
    "UncoveredBoxes",
    "Work",
    "certified_radius",
    "certify",
    "certify_path",
    "certify_sheets",
    "certify_singularities",
    "certify_workspace",
    "cusps",
    "design",
    "kantorovich_radius",
    "largest_ball",
    "largest_cube",
    "merge",
    "newton_steps",
    "scalar_coordinates_at",
    "scaled_links",
    "serial_singularities",
    "singularities",
    "singularity_distance",
    "split_region",
    "theorem2",
    "theorem2_radius",
]
